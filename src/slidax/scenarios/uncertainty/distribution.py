"""From the unit interval to values by a distribution: inverse distribution functions."""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np

from slidax._errors import DefinitionError, shown

from .leaf import Array

Distribution = Literal["uniform", "log_uniform", "triangular", "normal"]
"""`log_uniform`: each factor alike; `triangular`: its peak in the middle; `normal`: cut at both ends."""

TAIL = 1e-16
"""The cube's faces, where a normal distribution has no end."""


class Cut(NamedTuple):
    """Mean and deviation of a normal distribution that is cut; None: the middle, and a sixth of the width."""

    mean: float | None = None
    deviation: float | None = None


def shares(u: Array, lower: Array, upper: Array, distribution: Distribution, cut: Cut) -> Array:
    """The values at shares u of the probability, between two ends.

    - `u`: in [0, 1).
    - `lower`, `upper`: the ends.
    - `distribution`: on what lies between.
    - `cut`: of a normal one.

    Raises DefinitionError if there is no such distribution between these ends.
    """
    if distribution == "log_uniform":
        if not (lower > 0).all():
            raise DefinitionError(f"`log_uniform` needs ends > 0; got {shown(lower)}")
        values: Array = lower * (upper / lower) ** u
    elif distribution == "triangular":
        share = np.where(u < 0.5, np.sqrt(0.5 * u), 1.0 - np.sqrt(0.5 * (1.0 - u)))
        values = lower + (upper - lower) * share
    elif distribution == "normal":
        # Here, since few files need it and it takes a third of a short command's start.
        from scipy.special import ndtr, ndtri

        mean = 0.5 * (lower + upper) if cut.mean is None else cut.mean
        width = (upper - lower) / 6.0 if cut.deviation is None else cut.deviation
        width = np.where(np.asarray(width) > 0, width, 1.0)
        low, high = ndtr((lower - mean) / width), ndtr((upper - mean) / width)
        values = mean + width * ndtri(np.clip(low + u * (high - low), TAIL, 1.0 - TAIL))
    else:
        values = lower + (upper - lower) * u
    # Rounding must not lead out of the set.
    return np.clip(values, lower, upper)


def cut_normal(u: Array, sigmas: float = 8.0) -> Array:
    """Normal numbers of mean 0 and deviation 1, before the cut.

    - `u`: in [0, 1).
    - `sigmas`: where it is cut at both sides.
    """
    from scipy.special import ndtr, ndtri

    low = ndtr(-sigmas)
    return ndtri(np.clip(low + u * (1.0 - 2.0 * low), TAIL, 1.0 - TAIL))
