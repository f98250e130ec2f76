"""The robot's loop: one step of a law behind its guards, and that step as a C project."""

from .guarded_step import GuardedStep as GuardedStep
from .held import Held as Held
from .held import SensorRange as SensorRange
from .project import export_c as export_c
