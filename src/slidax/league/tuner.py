"""The tuner of the benchmark, the same for all schemes."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slidax.studies.search import lowest

SEED = 7


def tuned(objective: Callable[[NDArray[Any]], NDArray[Any]], dimension: int, budget: int) -> NDArray[Any]:
    """Return the best gains of spread points and CMA-ES (`lowest`), as a point of the unit cube.

    - `objective`: from points [points, dimension] to costs [points].
    - `budget`: largest number of points.
    """
    search = lowest(objective, dimension, evaluations=budget, seed=SEED, islands=2, keep=1)
    return search.points[0] if len(search.points) else np.full(dimension, 0.5)
