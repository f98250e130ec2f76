"""The exported step in a loop: against a simulated arm, in real time, and again from a log."""

from .arm_plan import ArmPlan as ArmPlan
from .arm_plan import arm_plan as arm_plan
from .law_plan import LawPlan as LawPlan
from .law_plan import guarded as guarded
from .law_plan import law_plan as law_plan
from .lockstep import Stepped as Stepped
from .lockstep import lockstep as lockstep
