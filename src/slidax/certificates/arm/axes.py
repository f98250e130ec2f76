"""The numbers of a set that may be otherwise, each from one end to the other."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from slidax._errors import DefinitionError
from slidax.scenarios.uncertainty import AbstractSet, Leaf
from slidax.scenarios.uncertainty.sets import Ball

from ..ends import ends_of, values_along
from .evaluated import Floats

SHARES = np.linspace(0.0, 1.0, 9)
"""Places on the way of a set at which its values are compared with a line."""


@dataclass(frozen=True)
class Axis:
    """One number, or some that move together, from one end to the other.

    - `path`: in the scenario file.
    - `entry`: which of its numbers; None for all of them together.
    - `lower`, `upper`: its ends, of the shape of the whole value.
    """

    path: str
    entry: int | None
    lower: Floats
    upper: Floats

    @property
    def name(self) -> str:
        """As it is called in a text."""
        return self.path if self.entry is None else f"{self.path}[{self.entry}]"

    def between(self, low: float, high: float) -> Axis:
        """A part of it.

        - `low`, `high`: shares of its way.
        """
        ends = [self.lower + share * (self.upper - self.lower) for share in (low, high)]
        return Axis(self.path, self.entry, *ends)

    def moved(self, value: Floats, share: Floats) -> Floats:
        """The values [P ...] with this axis at shares of its way [P].

        - `value`: before.
        - `share`: 0 at the lower end, 1 at the upper one.
        """
        reached = self.lower + share.reshape(-1, *[1] * self.lower.ndim) * (self.upper - self.lower)
        if self.entry is None:
            return reached
        here = np.arange(self.lower.size).reshape(self.lower.shape) == self.entry
        return np.where(here, reached, value)


def axes_of(path: str, one: AbstractSet, leaf: Leaf) -> list[Axis]:
    """The axes of a set: a box that holds it, as long as it is no line.

    - `path`: in the scenario file.
    - `one`: the set; `leaf`: what it is of.

    Raises DefinitionError for whole numbers.
    """
    if leaf.integer:
        raise DefinitionError("no certificate covers a set of a whole number of the arm or its disturbance", where=path)
    lower, upper = (np.asarray(end, float) for end in ends_of(one, leaf))
    if not isinstance(one, Ball):
        drawn = np.asarray(values_along(one, leaf, SHARES), float)
        if one.coordinates(leaf) == 1 and _is_a_line(drawn, lower, upper):
            return [] if (lower == upper).all() else [Axis(path, None, *_of_a_line(drawn))]
    flat_lower, flat_upper = lower.reshape(-1), upper.reshape(-1)
    return [Axis(path, k, lower, upper) for k in np.flatnonzero(flat_lower < flat_upper).tolist()]


def _of_a_line(drawn: Floats) -> tuple[Floats, Floats]:
    """The ends of the values: where the first number that varies has its least and its largest."""
    flat = drawn.reshape(len(drawn), -1)
    varies = int(np.argmax(np.ptp(flat, axis=0) > 0))
    return drawn[int(np.argmin(flat[:, varies]))], drawn[int(np.argmax(flat[:, varies]))]


def _is_a_line(drawn: Floats, lower: Floats, upper: Floats) -> bool:
    """Whether all of its numbers go from end to end together, each by the same share of its way."""
    first, last = _of_a_line(drawn)
    flat = drawn.reshape(len(drawn), -1)
    width = (last - first).reshape(-1)
    varies = np.abs(width) > 0
    if (np.ptp(flat, axis=0)[~varies] > 0).any():
        return False
    shares = (flat - first.reshape(-1))[:, varies] / width[varies]
    return bool((np.ptp(shares, axis=1) < 1e-9).all()) if varies.any() else True
