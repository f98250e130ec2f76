"""Performance functions: the radius of the envelope over time."""

from .exponential import Exponential as Exponential
from .finite_time import FiniteTime as FiniteTime
from .fixed_time import FixedTime as FixedTime
from .performance import AbstractPerformance as AbstractPerformance
