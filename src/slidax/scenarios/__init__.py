"""Scenarios: a closed loop as a YAML file, validated, and built from parts."""

from .catalogue import catalogue as catalogue
from .catalogue import explained as explained
from .description import ScenarioDescription as ScenarioDescription
from .load import altered as altered
from .load import load as load
from .load import names as names
from .load import parse as parse
from .named_robot import named_robot as named_robot
from .portable import brought_back as brought_back
from .portable import portable as portable
from .scenario import Scenario as Scenario
from .schema import schema as schema
