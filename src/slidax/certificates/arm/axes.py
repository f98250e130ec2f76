"""The uncertain values of a set, each with its range."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from slidax._errors import DefinitionError
from slidax.scenarios.uncertainty import AbstractSet, Leaf
from slidax.scenarios.uncertainty.sets import Ball

from ..each import Floats
from ..ends import ends_of, values_along

SHARES = np.linspace(0.0, 1.0, 9)
"""Shares of a range at which the values of a set are compared with a line."""


@dataclass(frozen=True)
class Axis:
    """One value, or some that change together, from one end to the other.

    - `path`: in the scenario file.
    - `entry`: index into the values at this path; None for all of them together.
    - `lower`, `upper`: ends, of the shape of the whole value.
    """

    path: str
    entry: int | None
    lower: Floats
    upper: Floats

    @property
    def name(self) -> str:
        """Name for a text."""
        return self.path if self.entry is None else f"{self.path}[{self.entry}]"

    def between(self, low: float, high: float) -> Axis:
        """The part of the range from share `low` to share `high`."""
        ends = [self.lower + share * (self.upper - self.lower) for share in (low, high)]
        return Axis(self.path, self.entry, *ends)

    def moved(self, value: Floats, share: Floats) -> Floats:
        """The values [P ...] with this axis at shares of its range [P], 0 at the lower end and 1 at the upper one."""
        reached = self.lower + share.reshape(-1, *[1] * self.lower.ndim) * (self.upper - self.lower)
        if self.entry is None:
            return reached
        here = np.arange(self.lower.size).reshape(self.lower.shape) == self.entry
        return np.where(here, reached, value)


def axes_of(path: str, uncertainty: AbstractSet, leaf: Leaf) -> list[Axis]:
    """Return the axes of a set: a box that contains it, or one axis if it is a line.

    Raises DefinitionError for integers.
    """
    if leaf.integer:
        raise DefinitionError("no certificate covers a set of a whole number of the arm or its disturbance", where=path)
    lower, upper = (np.asarray(end, float) for end in ends_of(uncertainty, leaf))
    if not isinstance(uncertainty, Ball):
        drawn = np.asarray(values_along(uncertainty, leaf, SHARES), float)
        if uncertainty.coordinates(leaf) == 1 and _is_a_line(drawn, lower, upper):
            return [] if (lower == upper).all() else [Axis(path, None, *_of_a_line(drawn))]
    flat_lower, flat_upper = lower.reshape(-1), upper.reshape(-1)
    return [Axis(path, k, lower, upper) for k in np.flatnonzero(flat_lower < flat_upper).tolist()]


def _of_a_line(drawn: Floats) -> tuple[Floats, Floats]:
    """The ends of the values: where the first number that varies has its least and its largest."""
    flat = drawn.reshape(len(drawn), -1)
    varies = int(np.argmax(np.ptp(flat, axis=0) > 0))
    return drawn[int(np.argmin(flat[:, varies]))], drawn[int(np.argmax(flat[:, varies]))]


def _is_a_line(drawn: Floats, lower: Floats, upper: Floats) -> bool:
    """True if all numbers go from end to end together, each by the same share of its range."""
    first, last = _of_a_line(drawn)
    flat = drawn.reshape(len(drawn), -1)
    width = (last - first).reshape(-1)
    varies = np.abs(width) > 0
    if (np.ptp(flat, axis=0)[~varies] > 0).any():
        return False
    shares = (flat - first.reshape(-1))[:, varies] / width[varies]
    return bool((np.ptp(shares, axis=1) < 1e-9).all()) if varies.any() else True
