"""The law as a Functional Mock-up Unit, for Simulink, Modelica tools and co-simulation masters."""

from .export import Exported as Exported
from .export import export_fmu as export_fmu
from .platforms import NAMES as NAMES
