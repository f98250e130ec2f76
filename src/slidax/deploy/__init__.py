"""The law for the robot: one step with guards, and that step as a C project."""

from .guarded_step import GuardedStep as GuardedStep
from .measured import measured as measured
from .project import export_c as export_c
from .step_memory import StepMemory as StepMemory
