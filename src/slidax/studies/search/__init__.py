"""Searches of the unit cube, many points at once; what a point means is the caller's business."""

from .found import Found as Found
from .found import apart as apart
from .front import Front as Front
from .front import non_dominated as non_dominated
from .lowest import lowest as lowest
from .several_aims import Judged as Judged
from .several_aims import several_aims as several_aims
from .sobol_indices import SobolIndices as SobolIndices
from .sobol_indices import points_for_indices as points_for_indices
from .sobol_indices import sobol_indices as sobol_indices
from .spread import spread as spread
