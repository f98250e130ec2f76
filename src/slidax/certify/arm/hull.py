"""Convex hulls of an uncertainty set's torques and inertias, from finitely many members.

The set is a box with one axis for each uncertain value. Its members are the arms at the points of the box.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import reduce
from itertools import combinations
from math import prod

import numpy as np

from ..sampled_scenario import Floats
from .arm_motion import StateSequence, breakpoints, distinct_inertias, outer_torque, rigid_body_torque
from .members import Members

ROUNDING = 1e-9
"""Differences below this share of the largest value count as rounding errors."""

PROBE = 0.29
"""Share of a value's range at which the polynomial through the ends and the middle is checked."""

SAMPLED = 5
"""Number of points on the range of a value in which the torques are not a polynomial of degree up to 2."""

MOST_CORNERS = 96
"""Largest number of corners when groups of values that multiply each other are combined.

Further groups are enclosed in a box.
"""

NODES = {1: 2, 2: 3, 3: SAMPLED}
"""Number of points on an axis, by the function's degree in it."""

MOST_POINTS = 1024
"""Largest number of points of one group."""

BERNSTEIN = np.array([[1.0, 0.0, 0.0], [-0.5, 2.0, -0.5], [0.0, 0.0, 1.0]])
"""Maps values at 0, 1/2 and 1 to Bernstein coefficients; the middle coefficient is `2 f(1/2) - (f(0) + f(1))/2`."""


@dataclass(frozen=True)
class Hull:
    """Set that contains a function's values for all members: convex combinations of corners, plus `Σ x_k effect_k`.

    Each |x_k| is at most 1. The function is evaluated at P members. Each corner and each effect is a weighted sum of
    these P values.

    - `points`: points of the box at which members are evaluated [P D]; the first is the middle of the box.
    - `corners`: weights of each corner [K P].
    - `effects`: weights of each effect [E P]. An effect is the function's change by half the range of a value.
    - `sampled`: axes that were only sampled: along them the function is no polynomial of degree up to 2, or too many
      values multiply each other.
    - `without`: axes on which the function does not depend.
    """

    points: Floats
    corners: Floats
    effects: Floats
    sampled: tuple[int, ...]
    without: tuple[int, ...]

    def of(self, values: Floats) -> tuple[Floats, Floats]:
        """Return corners [K ...] and effects [E ...], from the values of the members at `points` [P ...]."""
        flat = values.reshape(len(values), -1)
        weighted = [
            (weights @ flat).reshape(len(weights), *values.shape[1:]) for weights in (self.corners, self.effects)
        ]
        return weighted[0], weighted[1]


def convex_hull(evaluate: Callable[[Floats], Floats], dimensions: int) -> Hull:
    """Return the convex hull of a function's values over all members of an uncertainty set.

    Evaluations at random points determine the function's degree in each uncertain value, and the pairs of values that
    it multiplies. Two different polynomials agree at a random point with probability 0.

    - `evaluate`: maps points of the box [P D] to the function values of their members [P F].
    - `dimensions`: D.
    """
    middle = np.full(dimensions, 0.5)
    if dimensions == 0:
        weights = np.ones((1, 1))
        return Hull(middle[None], weights, np.zeros((0, 1)), (), ())
    degrees = _degrees(evaluate, dimensions)
    groups = _groups(evaluate, degrees)
    points, sampled = [middle], [k for k, degree in enumerate(degrees) if degree > 2]
    single: list[int] = []
    controls: list[tuple[int, Floats]] = []
    for group in groups:
        if len(group) == 1 and degrees[group[0]] == 1:
            single.append(len(points))
            points.append(_with_shares(middle, group, np.ones(1)))
            continue
        if prod(NODES[degrees[k]] for k in group) > MOST_POINTS:
            # Random corners of the group are a test, not a bound.
            sampled += [k for k in group if k not in sampled]
            control_points: tuple[Floats, Floats] = _random_corners(len(group)), np.eye(MOST_POINTS)
        else:
            control_points = _control_points(degrees, group)
        shares, matrix = control_points
        controls.append((len(points), matrix))
        points += [_with_shares(middle, group, row) for row in shares]
    total = len(points)
    base = np.eye(total)[:1]
    effects = [np.eye(total)[k] - base[0] for k in single]
    corners = base
    for first, matrix in sorted(controls, key=lambda control: -len(control[1])):
        added = np.zeros((len(matrix), total))
        added[:, first : first + matrix.shape[1]] = matrix
        if len(corners) == 1 or len(corners) * len(added) <= MOST_CORNERS:
            corners = (corners[:, None] + (added - base)[None]).reshape(-1, total)
        else:
            # A convex combination of points is their mean plus `Σ x_i d_i/2` with |x_i| <= 1, and d_i a point less the
            # mean.
            corners = corners + added.mean(axis=0) - base
            effects += list(0.5 * (added - added.mean(axis=0)))
    without = tuple(k for k, degree in enumerate(degrees) if degree == 0)
    listed = np.array(effects).reshape(-1, total)
    return Hull(np.array(points), corners, listed, tuple(sampled), without)


def _degrees(evaluate: Callable[[Floats], Floats], dimensions: int) -> list[int]:
    """Return the degree in each axis: 0 to 2, or 3 if the function is not a polynomial of degree up to 2.

    An axis without effect at a random point may have an effect at an end of the other axes. For example, the stiffness
    of a stop has an effect only where the arm touches the stop.
    """
    degrees = _degrees_at(evaluate, np.random.default_rng(1).uniform(0.1, 0.9, dimensions), list(range(dimensions)))
    for end in (0.0, 1.0):
        idle = [k for k, degree in enumerate(degrees) if degree == 0]
        if idle:
            for k, degree in zip(idle, _degrees_at(evaluate, np.full(dimensions, end), idle), strict=True):
                degrees[k] = degree
    return degrees


def _degrees_at(evaluate: Callable[[Floats], Floats], base: Floats, axes: Sequence[int]) -> list[int]:
    """Return the degrees in some axes, with all others fixed at a point of the box."""
    shares = (0.0, 0.5, 1.0, PROBE)
    points = [_with_shares(base, (k,), np.array([share])) for k in axes for share in shares]
    values = evaluate(np.array(points)).reshape(len(axes), len(shares), -1)
    scale = ROUNDING * max(float(np.abs(values).max()), 1e-300)
    degrees = []
    for low, half, high, probe in values:
        line = low + PROBE * (high - low)
        curvature = half - 0.5 * (low + high)
        parabola = line + 4.0 * PROBE * (1.0 - PROBE) * curvature
        if max(np.abs(high - low).max(), np.abs(curvature).max(), np.abs(probe - low).max()) <= scale:
            degrees.append(0)
        elif max(np.abs(curvature).max(), np.abs(probe - line).max()) <= scale:
            degrees.append(1)
        else:
            degrees.append(2 if np.abs(probe - parabola).max() <= scale else 3)
    return degrees


def _groups(evaluate: Callable[[Floats], Floats], degrees: Sequence[int]) -> list[list[int]]:
    """Return the axes in groups; the function is a sum of terms, each of which depends on the values of one group."""
    acting = [k for k, degree in enumerate(degrees) if degree]
    pairs = list(combinations(acting, 2))
    group = {k: {k} for k in acting}
    if not pairs:
        return [[k] for k in acting]
    base = np.random.default_rng(2).uniform(0.1, 0.9, len(degrees))
    ends = [np.array(corner) for corner in ((0.0, 0.0), (0.0, 1.0), (1.0, 0.0), (1.0, 1.0))]
    values = evaluate(np.array([_with_shares(base, pair, end) for pair in pairs for end in ends]))
    values = values.reshape(len(pairs), 4, -1)
    scale = ROUNDING * max(float(np.abs(values).max()), 1e-300)
    mixed = np.abs(values[:, 3] - values[:, 2] - values[:, 1] + values[:, 0]).max(axis=1)
    for (i, j), size in zip(pairs, mixed, strict=True):
        if size > scale and group[i] is not group[j]:
            joined = group[i] | group[j]
            for k in joined:
                group[k] = joined
    return [sorted(axes) for axes in {id(axes): axes for axes in group.values()}.values()]


def _control_points(degrees: Sequence[int], group: Sequence[int]) -> tuple[Floats, Floats]:
    """Return points as shares of a group's axes [P k], and the matrix from values there to Bernstein coefficients.

    For an axis of degree 3, which is only sampled, the values take the place of coefficients.
    """
    nodes = {1: np.array([0.0, 1.0]), 2: np.array([0.0, 0.5, 1.0]), 3: np.linspace(0.0, 1.0, SAMPLED)}
    matrices = {1: np.eye(2), 2: BERNSTEIN, 3: np.eye(SAMPLED)}
    shares = np.stack(np.meshgrid(*(nodes[degrees[k]] for k in group), indexing="ij"), axis=-1).reshape(-1, len(group))
    return shares, reduce(np.kron, (matrices[degrees[k]] for k in group))


def _random_corners(count: int) -> Floats:
    """Return corners of a box and then their opposite ones [P D]; the first corner has all values at the upper end."""
    half = np.random.default_rng(3).integers(0, 2, (MOST_POINTS // 2, count)).astype(float)
    half[0] = 1.0
    return np.concatenate([half, 1.0 - half])


def _with_shares(point: Floats, axes: Sequence[int], shares: Floats) -> Floats:
    """Return the point with other shares on some axes."""
    changed = point.copy()
    changed[list(axes)] = shares
    return changed


PROBES = 48
"""Number of random states, and of states of the motion, that determine the degrees of a set's values."""


def probe_torques(members: Members, points: Floats) -> Floats:
    """Return the torques of members at random states, and at some states of the motion [P F], N m or N.

    The times are random, since a periodic force could be zero at evenly spaced times. A short force may lie between two
    random times. So the times at which a force starts, jumps or ends are added, and the times of brief contacts.

    - `points`: points of the set's box [P D]. F counts the states and joints.
    """
    random = np.random.default_rng(0)
    motion, plants = StateSequence.of(members.scenario), members.plants(points)
    end = members.scenario.t1
    jumps = breakpoints(plants, end)
    pulses = jumps[:-1] + 0.5 * np.diff(jumps)
    t = np.concatenate([np.sort(random.uniform(0.0, end, PROBES)), jumps, pulses, members.brief_force_times])
    few = motion.at(t, instants=1)
    normal = np.random.default_rng(1).normal(size=(3, PROBES, motion.joints))
    count = len(few.t)
    q, dq, ddq = (np.resize(values, (count, motion.joints)) for values in normal)
    states = StateSequence(
        np.concatenate([few.t, few.t]),
        np.concatenate([q, few.q]),
        np.concatenate([dq, few.dq]),
        np.concatenate([ddq, few.ddq]),
    )
    distinct, indices = distinct_inertias(plants)
    torque = rigid_body_torque(distinct, states)[1][indices] - outer_torque(plants, states)
    return torque.reshape(len(points), -1)
