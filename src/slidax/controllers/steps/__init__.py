"""Steps: a law in discrete time, evaluated for the state in which its torque will set in."""

from .recovery import Recovery as Recovery
from .sliding_step import SlidingStep as SlidingStep
from .step import AbstractStep as AbstractStep
from .step import Decision as Decision
from .step import Moment as Moment
from .surface_step import AbstractSurfaceStep as AbstractSurfaceStep
from .twisting_step import TwistingStep as TwistingStep
