"""Scenarios: a closed loop as a YAML file, validated, and built from parts.

Start with `scenario.py`: `ScenarioDescription` is the content of a file, `Scenario` the closed loop built from it.
`load.py` reads files, `changes.py` sets values by path, `yaml_text.py` reads and writes YAML. The other files describe
one block of a scenario each: `robots.py`, `trajectories.py`, `instruments.py`, `schemes.py`, `sampled_data.py`.
`uncertainty.py` and `family.py` define the sets from which studies draw values; `draft.py` implements `slidax new`.
"""

from .catalogue import catalogue as catalogue
from .catalogue import explain_parameters as explain_parameters
from .catalogue import schema as schema
from .draft import Draft as Draft
from .draft import draft as draft
from .draft import new as new
from .load import alter as alter
from .load import load as load
from .load import names as names
from .load import parse as parse
from .load import portable_text as portable_text
from .load import restore as restore
from .named_robot import named_robot as named_robot
from .own_code import allow_code as allow_code
from .scenario import Scenario as Scenario
from .scenario import ScenarioDescription as ScenarioDescription
