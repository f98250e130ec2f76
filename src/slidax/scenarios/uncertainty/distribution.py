"""Inverse distribution functions, from the unit interval to values."""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np

from slidax._errors import DefinitionError, shown

from .leaf import Array

Distribution = Literal["uniform", "log_uniform", "triangular", "normal"]
"""`log_uniform`: uniform logarithm; `triangular`: peak in the middle; `normal`: cut at both ends."""

TAIL = 1e-16
"""Distance from the faces of the cube, at which a normal distribution is infinite."""


class Cut(NamedTuple):
    """Mean and deviation of a truncated normal distribution; None: the middle, and a sixth of the width."""

    mean: float | None = None
    deviation: float | None = None


def shares(u: Array, lower: Array, upper: Array, distribution: Distribution, cut: Cut) -> Array:
    """Return the values between two ends at cumulative probabilities u in [0, 1).

    Raises DefinitionError if the distribution does not exist between these ends.
    """
    if distribution == "log_uniform":
        if not (lower > 0).all():
            raise DefinitionError(f"`log_uniform` needs ends > 0; got {shown(lower)}")
        values: Array = lower * (upper / lower) ** u
    elif distribution == "triangular":
        share = np.where(u < 0.5, np.sqrt(0.5 * u), 1.0 - np.sqrt(0.5 * (1.0 - u)))
        values = lower + (upper - lower) * share
    elif distribution == "normal":
        # Imported here, since few files need it and the import takes a third of a short command's start.
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
    """Return standard normal numbers, cut at `sigmas` on both sides, at cumulative probabilities u in [0, 1)."""
    from scipy.special import ndtr, ndtri

    low = ndtr(-sigmas)
    return ndtri(np.clip(low + u * (1.0 - 2.0 * low), TAIL, 1.0 - TAIL))
