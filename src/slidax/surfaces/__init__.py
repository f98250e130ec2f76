"""Sliding surfaces `s = ė + φ(t, e)`: the motion that the error follows once s = 0."""

from .smooth_fixed_time import SmoothFixedTime as SmoothFixedTime
from .surface import AbstractSurface as AbstractSurface
