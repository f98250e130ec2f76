"""The convex hull of a set's torques, from few members.

Masses, rotors, friction, payloads and forces enter the torque linearly, centres of mass and lengths by their squares.
A polynomial of degree 2 in a value lies in the convex hull of its three Bernstein coefficients, one of degree 1 in that
of its ends, with weights that are the same for each time and joint. So the torque of every member, as a signal, is a
convex combination of few signals.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import reduce
from itertools import combinations
from math import prod

import numpy as np

from ..each import Floats

ROUNDING = 1e-9
"""Relative to the largest value: smaller differences are rounding errors."""

PROBE = 0.29
"""A fourth point on the range of a value, at which a polynomial through three is checked."""

SAMPLED = 5
"""Points on the range of a value that does not enter as a polynomial of degree 2."""

MOST_CORNERS = 96
"""Largest number of corners of several groups of multiplied values; further groups are boxed in."""

NODES = {1: 2, 2: 3, 3: SAMPLED}
"""Number of points on an axis of each degree."""

MOST_POINTS = 1024
"""Largest number of points of one group."""

BERNSTEIN = np.array([[1.0, 0.0, 0.0], [-0.5, 2.0, -0.5], [0.0, 0.0, 1.0]])
"""From the values at 0, 1/2, 1 to the coefficients: the middle one is `2 f(1/2) - (f(0) + f(1))/2`."""


@dataclass(frozen=True)
class Hull:
    """All members as `corner + Σ x effect`, for a convex combination of corners and any x in [-1, 1] for each effect.

    - `points`: of the box [P D], at which members are evaluated; the first is its middle.
    - `corners`: weights of the evaluated members for each corner [K P].
    - `effects`: weights for the effect of half a value's range [E P].
    - `axes`: axis of each effect; -1 for a value of a group that was boxed in.
    - `sampled`: axes that are no polynomials of degree 2 and were sampled.
    - `without`: axes without effect.
    """

    points: Floats
    corners: Floats
    effects: Floats
    axes: tuple[int, ...]
    sampled: tuple[int, ...]
    without: tuple[int, ...]

    def of(self, values: Floats) -> tuple[Floats, Floats]:
        """Corners [K ...] and effects [E ...] of the values [P ...] that the members at `points` have."""
        flat = values.reshape(len(values), -1)
        weighted = [
            (weights @ flat).reshape(len(weights), *values.shape[1:]) for weights in (self.corners, self.effects)
        ]
        return weighted[0], weighted[1]

    def largest(self, values: Floats) -> Floats:
        """The largest |value| over all members [...], from the values [P ...] at `points`."""
        corners, effects = self.of(values)
        return np.abs(corners).max(axis=0) + np.abs(effects).sum(axis=0)

    def merged(self, which: Sequence[int]) -> Hull:
        """The hull in terms of distinct members.

        - `which`: the number of each member's kind [P].
        """
        kinds = max(which) + 1
        gathered = np.zeros((len(which), kinds))
        gathered[np.arange(len(which)), list(which)] = 1.0
        corners = np.unique(self.corners @ gathered, axis=0)
        effects = self.effects @ gathered
        acting = np.abs(effects).max(axis=1) > 1e-12
        first = [list(which).index(kind) for kind in range(kinds)]
        axes = tuple(axis for axis, acts in zip(self.axes, acting, strict=True) if acts)
        return Hull(self.points[first], corners, effects[acting], axes, self.sampled, self.without)


def hull_of(evaluate: Callable[[Floats], Floats], dimensions: int) -> Hull:
    """Return the convex hull of a function of all members.

    The degree of each value, and the values it is multiplied with, follow from evaluations at random points:
    polynomials agree there by accident with probability 0.

    - `evaluate`: from points of the box [P D] to all values of each member [P F] that matter.
    - `dimensions`: D.
    """
    middle = np.full(dimensions, 0.5)
    if dimensions == 0:
        weights = np.ones((1, 1))
        return Hull(middle[None], weights, np.zeros((0, 1)), (), (), ())
    degrees = _degrees(evaluate, dimensions)
    groups = _groups(evaluate, degrees)
    points, sampled = [middle], [k for k, degree in enumerate(degrees) if degree > 2]
    single: list[tuple[int, int]] = []
    controls: list[tuple[int, Floats]] = []
    for group in groups:
        if len(group) == 1 and degrees[group[0]] == 1:
            single.append((group[0], len(points)))
            points.append(_with(middle, group, np.ones(1)))
            continue
        if prod(NODES[degrees[k]] for k in group) > MOST_POINTS:
            # Some random corners of the group: a test, not a bound.
            sampled += [k for k in group if k not in sampled]
            corners_of_group: tuple[Floats, Floats] = _corners(len(group)), np.eye(MOST_POINTS)
        else:
            corners_of_group = _control(degrees, group)
        shares, matrix = corners_of_group
        controls.append((len(points), matrix))
        points += [_with(middle, group, weights) for weights in shares]
    total = len(points)
    base = np.eye(total)[:1]
    effects, axes = [], []
    for axis, k in single:
        effects.append(np.eye(total)[k] - base[0])
        axes.append(axis)
    corners = base
    for first, matrix in sorted(controls, key=lambda control: -len(control[1])):
        there = np.zeros((len(matrix), total))
        there[:, first : first + matrix.shape[1]] = matrix
        if len(corners) == 1 or len(corners) * len(there) <= MOST_CORNERS:
            corners = (corners[:, None] + (there - base)[None]).reshape(-1, total)
        else:
            # A convex combination of points lies within their mean and half of each point's distance from the mean.
            corners = corners + there.mean(axis=0) - base
            effects += list(0.5 * (there - there.mean(axis=0)))
            axes += [-1] * len(there)
    without = tuple(k for k, degree in enumerate(degrees) if degree == 0)
    listed = np.array(effects).reshape(-1, total)
    return Hull(np.array(points), corners, listed, tuple(axes), tuple(sampled), without)


def _degrees(evaluate: Callable[[Floats], Floats], dimensions: int) -> list[int]:
    """Degree in each axis: 0 to 2, or 3 for everything else.

    An axis without effect at a random point may have one at an end of the others, as the stiffness of a stop has only
    where the arm touches it.
    """
    degrees = _degrees_at(evaluate, np.random.default_rng(1).uniform(0.1, 0.9, dimensions), list(range(dimensions)))
    for end in (0.0, 1.0):
        idle = [k for k, degree in enumerate(degrees) if degree == 0]
        if idle:
            for k, degree in zip(idle, _degrees_at(evaluate, np.full(dimensions, end), idle), strict=True):
                degrees[k] = degree
    return degrees


def _degrees_at(evaluate: Callable[[Floats], Floats], base: Floats, axes: Sequence[int]) -> list[int]:
    """Degrees in some axes, with all others fixed at a point of the box."""
    shares = (0.0, 0.5, 1.0, PROBE)
    points = [_with(base, (k,), np.array([share])) for k in axes for share in shares]
    values = evaluate(np.array(points)).reshape(len(axes), len(shares), -1)
    scale = ROUNDING * max(float(np.abs(values).max()), 1e-300)
    degrees = []
    for low, half, high, probe in values:
        line = low + PROBE * (high - low)
        bend = half - 0.5 * (low + high)
        parabola = line + 4.0 * PROBE * (1.0 - PROBE) * bend
        if max(np.abs(high - low).max(), np.abs(bend).max(), np.abs(probe - low).max()) <= scale:
            degrees.append(0)
        elif max(np.abs(bend).max(), np.abs(probe - line).max()) <= scale:
            degrees.append(1)
        else:
            degrees.append(2 if np.abs(probe - parabola).max() <= scale else 3)
    return degrees


def _groups(evaluate: Callable[[Floats], Floats], degrees: Sequence[int]) -> list[list[int]]:
    """Sets of axes that are multiplied by each other; different sets add up."""
    acting = [k for k, degree in enumerate(degrees) if degree]
    pairs = list(combinations(acting, 2))
    group = {k: {k} for k in acting}
    if not pairs:
        return [[k] for k in acting]
    base = np.random.default_rng(2).uniform(0.1, 0.9, len(degrees))
    ends = [np.array(corner) for corner in ((0.0, 0.0), (0.0, 1.0), (1.0, 0.0), (1.0, 1.0))]
    values = evaluate(np.array([_with(base, pair, end) for pair in pairs for end in ends]))
    values = values.reshape(len(pairs), 4, -1)
    scale = ROUNDING * max(float(np.abs(values).max()), 1e-300)
    mixed = np.abs(values[:, 3] - values[:, 2] - values[:, 1] + values[:, 0]).max(axis=1)
    for (i, j), size in zip(pairs, mixed, strict=True):
        if size > scale and group[i] is not group[j]:
            joined = group[i] | group[j]
            for k in joined:
                group[k] = joined
    return [sorted(axes) for axes in {id(axes): axes for axes in group.values()}.values()]


def _control(degrees: Sequence[int], group: Sequence[int]) -> tuple[Floats, Floats]:
    """Shares of a group's axes [P k], and the matrix from the values there to control values."""
    nodes = {1: np.array([0.0, 1.0]), 2: np.array([0.0, 0.5, 1.0]), 3: np.linspace(0.0, 1.0, SAMPLED)}
    matrices = {1: np.eye(2), 2: BERNSTEIN, 3: np.eye(SAMPLED)}
    shares = np.stack(np.meshgrid(*(nodes[degrees[k]] for k in group), indexing="ij"), axis=-1).reshape(-1, len(group))
    return shares, reduce(np.kron, (matrices[degrees[k]] for k in group))


def _corners(count: int) -> Floats:
    """Return corners of a box, half of them opposite to the others, at first with all high, all low [P D]."""
    half = np.random.default_rng(3).integers(0, 2, (MOST_POINTS // 2, count)).astype(float)
    half[0] = 1.0
    return np.concatenate([half, 1.0 - half])


def _with(point: Floats, axes: Sequence[int], shares: Floats) -> Floats:
    """The point with other shares on some axes."""
    moved = point.copy()
    moved[list(axes)] = shares
    return moved
