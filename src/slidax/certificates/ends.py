"""The range of each value in an uncertainty set."""

from __future__ import annotations

import numpy as np

from slidax.scenarios.uncertainty import AbstractSet, Leaf
from slidax.scenarios.uncertainty.sets import Ball, Choice

from .each import Floats


def ends_of(uncertainty: AbstractSet, leaf: Leaf) -> tuple[Floats, Floats]:
    """Return the least and the largest value that each number of a set can have."""
    if isinstance(uncertainty, Ball):
        own = leaf.own_value("ball")
        return own - uncertainty.ball, own + uncertainty.ball
    values = values_along(uncertainty, leaf, np.array([0.0, 1.0]))
    return values.min(axis=0), values.max(axis=0)


def values_along(uncertainty: AbstractSet, leaf: Leaf, shares: Floats) -> Floats:
    """Return values of a set whose coordinates all have the same share, or each value of a choice [K ...].

    All sets but a ball and a choice increase in each of their coordinates, and each number depends on one coordinate.

    - `uncertainty`: any set but a ball.
    - `shares`: from 0 to 1 [K]; not used for a choice.
    """
    if isinstance(uncertainty, Choice) and uncertainty.choice != "any":
        count = len(uncertainty.choice)
        weights = np.ones(count) if uncertainty.weights is None else np.asarray(uncertainty.weights, float)
        middles = np.cumsum(weights) / weights.sum() - 0.5 * weights / weights.sum()
        shares = middles[weights > 0]
    below = np.where(shares < 1.0, shares, np.nextafter(1.0, 0.0))
    return np.asarray(uncertainty.values(np.repeat(below[:, None], uncertainty.coordinates(leaf), axis=1), leaf))
