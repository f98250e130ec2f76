"""Discrete-time steps of laws, evaluated at the predicted state in which the torque sets in."""

from .recovery import Recovery as Recovery
from .sliding_step import SlidingStep as SlidingStep
from .step import AbstractStep as AbstractStep
from .step import Decision as Decision
from .step import Moment as Moment
from .surface_step import AbstractSurfaceStep as AbstractSurfaceStep
from .twisting_step import TwistingStep as TwistingStep
