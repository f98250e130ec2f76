"""The uncertainty set of a scenario: its canonical form, the range of each value, and the box of all starts."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from slidax.core.errors import DefinitionError
from slidax.scenarios.family import Family, Space
from slidax.scenarios.scenario import Scenario
from slidax.scenarios.uncertain_values import Leaf
from slidax.scenarios.uncertainty import AbstractSet, Ball, Discrete

from .sampled_scenario import Floats


def set_ends(uncertainty: AbstractSet, leaf: Leaf) -> tuple[Floats, Floats]:
    """Return the least and the largest value that a set allows, number by number, each in the shape of the value.

    - `uncertainty`: the set, as in the block `uncertainty` of a scenario.
    - `leaf`: the scenario's value that the set replaces, a number or a list.
    """
    if isinstance(uncertainty, Ball):
        own = leaf.own_value("ball")
        return own - uncertainty.ball, own + uncertainty.ball
    values = values_along(uncertainty, leaf, np.array([0.0, 1.0]))
    return values.min(axis=0), values.max(axis=0)


def values_along(uncertainty: AbstractSet, leaf: Leaf, shares: Floats) -> Floats:
    """Return K values of a set, from its lower end to its upper end [K ...].

    A set maps coordinates between 0 and 1 to its values. All coordinates have the same share here, so that each number
    moves from one end of its range to the other. For a choice from a list, return each value of the list instead.

    - `uncertainty`: any set except a ball. `leaf`: the scenario's value that the set replaces.
    - `shares`: coordinates, from 0 to 1 [K]; not used for a choice.
    """
    if isinstance(uncertainty, Discrete) and uncertainty.choice != "any":
        count = len(uncertainty.choice)
        weights = np.ones(count) if uncertainty.weights is None else np.asarray(uncertainty.weights, float)
        middles = np.cumsum(weights) / weights.sum() - 0.5 * weights / weights.sum()
        shares = middles[weights > 0]
    below = np.where(shares < 1.0, shares, np.nextafter(1.0, 0.0))
    return np.asarray(uncertainty.values(np.repeat(below[:, None], uncertainty.coordinates(leaf), axis=1), leaf))


@lru_cache(maxsize=4)
def family_of(scenario: Scenario) -> Family | None:
    """Return the uncertainty set of a scenario in canonical form; None for a scenario without uncertainty."""
    return to_canonical(Family.of(scenario.description)) if scenario.description.uncertainty else None


def to_canonical(family: Family) -> Family:
    """Return a set in the form that all certificates use, independent of the order in which it was written.

    Paths are sorted. A set of a single value is replaced by that value and is no longer uncertain.
    """
    space, truth, remaining = family.uncertain, dict(family.base.truth), {}
    for path in sorted(space.sets):
        lower, upper = set_ends(space.sets[path], space.leaves[path])
        own = space.leaves[path].own
        if not np.array_equal(lower, upper):
            remaining[path] = space.sets[path]
        elif own is None or not np.array_equal(np.broadcast_to(own, np.shape(lower)), lower):
            truth[path] = np.asarray(lower).tolist()
    base = family.base if truth == family.base.truth else family.base.model_copy(update={"truth": truth})
    return replace(family, base=base, uncertain=Space({path: space.leaves[path] for path in remaining}, remaining))


START = "start.q"


@dataclass(frozen=True)
class StartBox:
    """Range of the start positions.

    - `lower`, `upper`: least and largest position [n], rad or m.
    - `all_are`, `one_is`: subject and verb for sentences about all starts, and about a single start.
    """

    lower: Floats
    upper: Floats
    all_are: str
    one_is: str


def start_box(scenario: Scenario) -> StartBox:
    """Return the scenario's start, or the box around all starts if it is uncertain.

    Raises DefinitionError if a set is empty.
    """
    own = np.asarray(scenario.state0.q, float)
    family = family_of(scenario)
    sets = {} if family is None else family.space.sets
    paths = [path for path in sets if path == START or path.startswith(f"{START}.")]
    if family is None or not paths:
        return StartBox(own, own, "the start is", "the start is")
    lower, upper = own.copy(), own.copy()
    for path in paths:
        least, most = set_ends(sets[path], family.space.leaves[path])
        joint = slice(None) if path == START else int(path.rpartition(".")[2])
        lower[joint], upper[joint] = least, most
    return StartBox(lower, upper, "all starts of the uncertain set are", "a start of the uncertain set is")


SHARES = np.linspace(0.0, 1.0, 9)
"""Shares of the range at which values of a set are compared with a straight line."""


@dataclass(frozen=True)
class UncertainValue:
    """Range of a number, or of all numbers of a list that vary together, from a lower to an upper end.

    - `path`: dotted path of the value in the scenario file.
    - `entry`: index of the number in the flattened value; None if all numbers vary together.
    - `lower`, `upper`: ends, in the shape of the whole value.
    """

    path: str
    entry: int | None
    lower: Floats
    upper: Floats

    @property
    def name(self) -> str:
        """Name in assumptions and messages."""
        return self.path if self.entry is None else f"{self.path}[{self.entry}]"

    def moved(self, value: Floats, share: Floats) -> Floats:
        """Return values [P ...] in which this number, or all numbers, are at the shares of their range.

        - `value`: values that the other numbers keep [P ...]. `share`: 0 for the lower end, 1 for the upper one [P].
        """
        moved = self.lower + share.reshape(-1, *[1] * self.lower.ndim) * (self.upper - self.lower)
        if self.entry is None:
            return moved
        is_entry = np.arange(self.lower.size).reshape(self.lower.shape) == self.entry
        return np.where(is_entry, moved, value)


def uncertain_values(path: str, uncertainty: AbstractSet, leaf: Leaf) -> list[UncertainValue]:
    """Return the axes of a box that contains a set: one for each number, or a single axis if the set is a line.

    - `path`: dotted path of the value in the scenario. `uncertainty`: its set. `leaf`: the value that it replaces.

    Raises DefinitionError for integers.
    """
    if leaf.integer:
        raise DefinitionError(
            "no certificate covers an uncertain integer of the arm or its disturbance: leave it out of `uncertainty`",
            where=path,
        )
    lower, upper = (np.asarray(end, float) for end in set_ends(uncertainty, leaf))
    if not isinstance(uncertainty, Ball):
        drawn = np.asarray(values_along(uncertainty, leaf, SHARES), float)
        if uncertainty.coordinates(leaf) == 1 and _is_a_line(drawn):
            return [] if (lower == upper).all() else [UncertainValue(path, None, *_line_ends(drawn))]
    flat_lower, flat_upper = lower.reshape(-1), upper.reshape(-1)
    return [UncertainValue(path, k, lower, upper) for k in np.flatnonzero(flat_lower < flat_upper).tolist()]


def _line_ends(drawn: Floats) -> tuple[Floats, Floats]:
    """Return the two values at which the first number that varies is least and largest."""
    flat = drawn.reshape(len(drawn), -1)
    varies = int(np.argmax(np.ptp(flat, axis=0) > 0))
    return drawn[int(np.argmin(flat[:, varies]))], drawn[int(np.argmax(flat[:, varies]))]


def _is_a_line(drawn: Floats) -> bool:
    """Return True if the values lie on a line: in each value, all numbers have the same share of their ranges."""
    first, last = _line_ends(drawn)
    flat = drawn.reshape(len(drawn), -1)
    width = (last - first).reshape(-1)
    varies = np.abs(width) > 0
    if (np.ptp(flat, axis=0)[~varies] > 0).any():
        return False
    shares = (flat - first.reshape(-1))[:, varies] / width[varies]
    return bool((np.ptp(shares, axis=1) < 1e-9).all()) if varies.any() else True
