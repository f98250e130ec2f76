"""The least and the largest value of each number of a set."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from slidax.scenarios.uncertainty import AbstractSet, Leaf
from slidax.scenarios.uncertainty.sets import Ball, Choice

Floats = NDArray[np.floating[Any]]


def ends_of(one: AbstractSet, leaf: Leaf) -> tuple[Floats, Floats]:
    """The least and the largest value of each number of a set.

    - `one`: the set.
    - `leaf`: what it is of.
    """
    if isinstance(one, Ball):
        own = leaf.own_value("ball")
        return own - one.ball, own + one.ball
    values = values_along(one, leaf, np.array([0.0, 1.0]))
    return values.min(axis=0), values.max(axis=0)


def values_along(one: AbstractSet, leaf: Leaf, shares: Floats) -> Floats:
    """Values of a set whose coordinates all have the same share; each value of a choice [K ...].

    All sets but a ball and a choice increase in each of their coordinates, of which a number depends on one alone.

    - `one`: the set, which is no ball.
    - `leaf`: what it is of.
    - `shares`: from 0 to 1, for a set that is no choice [K].
    """
    if isinstance(one, Choice) and one.choice != "any":
        count = len(one.choice)
        weights = np.ones(count) if one.weights is None else np.asarray(one.weights, float)
        middles = np.cumsum(weights) / weights.sum() - 0.5 * weights / weights.sum()
        shares = middles[weights > 0]
    cube = np.repeat(np.where(shares < 1.0, shares, np.nextafter(1.0, 0.0))[:, None], one.coordinates(leaf), axis=1)
    return np.asarray(one.values(cube, leaf))
