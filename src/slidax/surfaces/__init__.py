"""Sliding surfaces `s = ė + φ(t, e)`: the motion that the error follows once s = 0."""

from .linear import Linear as Linear
from .linear_core import LinearCoreFixedTime as LinearCoreFixedTime
from .singularity_free import SingularityFree as SingularityFree
from .sliding_variable import SlidingVariable as SlidingVariable
from .sliding_variable import sliding_variable as sliding_variable
from .smooth_fixed_time import SmoothFixedTime as SmoothFixedTime
from .surface import AbstractSurface as AbstractSurface
