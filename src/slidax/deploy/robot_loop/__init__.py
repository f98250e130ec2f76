"""The exported step in a loop: against a simulated arm, in real time, and again from a log."""

from .arm_plan import ArmPlan as ArmPlan
from .arm_plan import arm_plan as arm_plan
from .kept import attachments_of as attachments_of
from .kept import metadata_of as metadata_of
from .kept import write_stepped as write_stepped
from .law_plan import LawPlan as LawPlan
from .law_plan import guarded as guarded
from .law_plan import law_plan as law_plan
from .law_plan import require_samples as require_samples
from .lockstep import Stepped as Stepped
from .lockstep import lockstep as lockstep
from .loop import run_loop as run_loop
from .looped import Looped as Looped
from .replay import Replay as Replay
from .replay import replay as replay
