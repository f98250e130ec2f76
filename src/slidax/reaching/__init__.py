"""Reaching laws: the torque that drives the sliding variable to zero, and bounds of its size."""

from .bound import AbstractBound as AbstractBound
from .fixed_bound import FixedBound as FixedBound
from .fixed_time_reaching import FixedTimeReaching as FixedTimeReaching
from .reaching import AbstractReaching as AbstractReaching
from .saturated_reaching import SaturatedReaching as SaturatedReaching
from .state_bound import StateBound as StateBound
from .two_power_reaching import TwoPowerReaching as TwoPowerReaching
from .uncertainty_bound import UncertaintyBound as UncertaintyBound
