"""Points that are spread evenly, to begin with."""

from __future__ import annotations

import warnings

import numpy as np
from scipy.stats import qmc

CORNERS = 4
"""One in so many of the first points is a corner of the cube, where worst cases like to be."""


def spread(dimension: int, count: int, *, seed: int) -> np.ndarray:
    """Points of the unit cube [count, dimension]: its middle, some corners, and Sobol's sequence, scrambled.

    - `dimension`: of the cube.
    - `count`: how many points.
    - `seed`: of the scrambling and of the choice of corners.
    """
    rng = np.random.default_rng(seed)
    middle = np.full((1, dimension), 0.5)
    chosen = _corners(dimension, count // CORNERS, rng)
    left = max(0, count - 1 - len(chosen))
    with warnings.catch_warnings(action="ignore"):
        # Its balance wants a power of two; the search does not.
        between = qmc.Sobol(dimension, rng=rng).random(left)
    return np.concatenate([middle, chosen, between])[:count]


def _corners(dimension: int, most: int, rng: np.random.Generator) -> np.ndarray:
    """All of them if they are so few, else some, each once in all likelihood."""
    if 2**dimension <= most:
        return (np.arange(2**dimension)[:, None] >> np.arange(dimension) & 1).astype(float)
    return rng.integers(0, 2, (most, dimension)).astype(float)
