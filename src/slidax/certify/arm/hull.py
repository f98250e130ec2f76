"""Convex hulls of an uncertainty set's torques and inertias, from finitely many members."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import reduce
from itertools import combinations
from math import prod

import numpy as np

from slidax.scenarios.scenario import Scenario
from slidax.simulation.plant import Plant

from ..sampled_scenario import Floats
from .arm_motion import NominalModel, StateSequence, breakpoints, distinct_inertias, outer_torque, rigid_body_torque
from .members import Members

ROUNDING = 1e-9
"""Difference, relative to the largest value, up to which it is a rounding error."""

PROBE = 0.29
"""Share of a value's range at which the polynomial through three other points is checked."""

SAMPLED = 5
"""Number of points on the range of a value that does not enter as a polynomial of degree up to 2."""

MOST_CORNERS = 96
"""Largest number of corners of several groups of values that are multiplied; further groups are enclosed in a box."""

NODES = {1: 2, 2: 3, 3: SAMPLED}
"""Number of points on an axis of each degree."""

MOST_POINTS = 1024
"""Largest number of points of one group."""

BERNSTEIN = np.array([[1.0, 0.0, 0.0], [-0.5, 2.0, -0.5], [0.0, 0.0, 1.0]])
"""Maps values at 0, 1/2 and 1 to Bernstein coefficients; the middle one is `2 f(1/2) - (f(0) + f(1))/2`."""


@dataclass(frozen=True)
class Hull:
    """All members as `corner + Σ x effect`, for a convex combination of corners and any x in [-1, 1] for each effect.

    - `points`: points of the box at which members are evaluated [P D]; the first is its middle.
    - `corners`: weights of the evaluated members for each corner [K P].
    - `effects`: weights of the evaluated members for each effect, that of half a value's range [E P].
    - `axes`: axis of each effect; -1 for an effect of a group that is enclosed in a box.
    - `sampled`: axes that were sampled, as they do not enter as polynomials of degree up to 2.
    - `without`: axes without effect.
    """

    points: Floats
    corners: Floats
    effects: Floats
    axes: tuple[int, ...]
    sampled: tuple[int, ...]
    without: tuple[int, ...]

    def of(self, values: Floats) -> tuple[Floats, Floats]:
        """Return corners [K ...] and effects [E ...], from the values of the members at `points` [P ...]."""
        flat = values.reshape(len(values), -1)
        weighted = [
            (weights @ flat).reshape(len(weights), *values.shape[1:]) for weights in (self.corners, self.effects)
        ]
        return weighted[0], weighted[1]

    def largest(self, values: Floats) -> Floats:
        """Return the largest |value| over all members [...], from the values of the members at `points` [P ...]."""
        corners, effects = self.of(values)
        return np.abs(corners).max(axis=0) + np.abs(effects).sum(axis=0)

    def merged(self, indices: Sequence[int]) -> Hull:
        """Return the hull with weights of distinct members.

        - `indices`: index of each member among the distinct ones [P].
        """
        count = max(indices) + 1
        gathered = np.zeros((len(indices), count))
        gathered[np.arange(len(indices)), list(indices)] = 1.0
        corners = np.unique(self.corners @ gathered, axis=0)
        effects = self.effects @ gathered
        acting = np.abs(effects).max(axis=1) > 1e-12
        first = [list(indices).index(k) for k in range(count)]
        axes = tuple(axis for axis, acts in zip(self.axes, acting, strict=True) if acts)
        return Hull(self.points[first], corners, effects[acting], axes, self.sampled, self.without)


def convex_hull(evaluate: Callable[[Floats], Floats], dimensions: int) -> Hull:
    """Return the convex hull of a function of all members.

    The degree of each value, and the values it is multiplied with, are found by evaluations at random points, at which
    different polynomials agree with probability 0.

    - `evaluate`: maps points of the box [P D] to the function values of their members [P F].
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
            points.append(_with_shares(middle, group, np.ones(1)))
            continue
        if prod(NODES[degrees[k]] for k in group) > MOST_POINTS:
            # Some random corners of the group: a test, not a bound.
            sampled += [k for k in group if k not in sampled]
            control_points: tuple[Floats, Floats] = _random_corners(len(group)), np.eye(MOST_POINTS)
        else:
            control_points = _control_points(degrees, group)
        shares, matrix = control_points
        controls.append((len(points), matrix))
        points += [_with_shares(middle, group, row) for row in shares]
    total = len(points)
    base = np.eye(total)[:1]
    effects, axes = [], []
    for axis, k in single:
        effects.append(np.eye(total)[k] - base[0])
        axes.append(axis)
    corners = base
    for first, matrix in sorted(controls, key=lambda control: -len(control[1])):
        added = np.zeros((len(matrix), total))
        added[:, first : first + matrix.shape[1]] = matrix
        if len(corners) == 1 or len(corners) * len(added) <= MOST_CORNERS:
            corners = (corners[:, None] + (added - base)[None]).reshape(-1, total)
        else:
            # A convex combination of points deviates from their mean by at most half of each point's distance from it.
            corners = corners + added.mean(axis=0) - base
            effects += list(0.5 * (added - added.mean(axis=0)))
            axes += [-1] * len(added)
    without = tuple(k for k, degree in enumerate(degrees) if degree == 0)
    listed = np.array(effects).reshape(-1, total)
    return Hull(np.array(points), corners, listed, tuple(axes), tuple(sampled), without)


def _degrees(evaluate: Callable[[Floats], Floats], dimensions: int) -> list[int]:
    """Return the degree in each axis, 0 to 2, or 3 for a function that is no such polynomial.

    An axis without effect at a random point may have one at an end of the other axes: the stiffness of a stop has an
    effect only where the arm touches it.
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
    """Return groups of axes whose values are multiplied by each other; the function is a sum over the groups."""
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
    """Return points as shares of a group's axes [P k], and the matrix from the values there to Bernstein coefficients.

    An axis of degree 3 has its values in place of coefficients.
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


STRIDE = 8
"""Number of samples from one evaluation of K to the next; its slopes are computed at every fourth evaluation."""

STEP = 1e-4
"""Step of a central difference, rad or m."""

LARGEST_RADIUS = 0.8
"""Spectral radius of |A| up to which K is enclosed."""

PROBES = 48
"""Number of random states, and of states of the motion, at which the degrees of a set's values are found."""

SPARE = 1.5
"""Factor of a slope, for members and instants that were not evaluated."""


@dataclass(frozen=True, eq=False)
class SetPart:
    """A part of a set, along a motion.

    - `disturbance`: w* of each extreme member [M N n], rad/s² or m/s².
    - `effects`: change of w* by half the width of an uncertain value [E N n], rad/s² or m/s².
    - `low`, `high`: the least and the largest value of each entry of `K = M⁻¹M̂` [N n n].
    - `slope`: bounds of |∂K_ij/∂q_l| along the motion [N n n n].
    - `arms`: number of members at which K was evaluated; 0 if K is enclosed for the whole part.
    """

    members: Members
    disturbance: Floats
    effects: Floats
    low: Floats
    high: Floats
    slope: Floats
    arms: int

    def shrunk(self, share: float, disturbance: Floats) -> SetPart:
        """Return the part scaled by `share` around its middle.

        - `disturbance`: w* of the middle [N n].
        """
        middle = 0.5 * (self.low + self.high)
        low, high = (middle + share * (side - middle) for side in (self.low, self.high))
        return SetPart(
            self.members,
            disturbance + share * (self.disturbance - disturbance),
            share * self.effects,
            low,
            high,
            self.slope,
            self.arms,
        )


def set_part(
    scenario: Scenario,
    members: Members,
    motion: StateSequence,
    cases: Sequence[tuple[Plant, NominalModel]],
    disturbance: Floats | None,
) -> SetPart:
    """Return a part of a scenario's set along a motion.

    - `cases`: for a law that learns, arms with their learned models.
    - `disturbance`: w* of these arms [M N n].
    """
    if cases and disturbance is not None:
        low, high = _range([arm for arm, _ in cases], [known for _, known in cases], motion)
        slope = _slopes(cases, motion)
        return SetPart(members, disturbance, np.zeros((0, *motion.q.shape)), low, high, slope, len(cases))
    belief = NominalModel.of(scenario, members.plant)
    hull = convex_hull(lambda points: probe_torques(members, points), len(members.axes))
    plants = members.plants(hull.points)
    mass, bias = belief.mass_and_bias(motion.t, motion.q, motion.dq)
    nominal = np.einsum("kij,kj->ki", mass, motion.ddq) + bias + belief.friction(motion.t, motion.wanted_dq)
    distinct, indices = distinct_inertias(plants)
    residual = nominal - rigid_body_torque(distinct, motion)[1][indices] + outer_torque(plants, motion)
    corners, effects = hull.of(np.linalg.solve(mass[None], residual[..., None])[..., 0])
    arms, _ = distinct_inertias(members.plants(members.ends(hull.without)))
    slope = _slopes([(arm, belief) for arm in (arms[0], arms[len(arms) // 2], arms[-1])], motion)
    enclosure = _enclosure(distinct, hull.merged(indices), belief, motion)
    if enclosure is not None:
        return SetPart(members, corners, effects, *enclosure, slope, 0)
    return SetPart(members, corners, effects, *_range(arms, [belief] * len(arms), motion), slope, len(arms))


def probe_torques(members: Members, points: Floats) -> Floats:
    """Return the torques of members at random states and at some of the motion [P F].

    The times are random, so that a ripple is zero at all of them with probability 0. The times at which a force starts,
    jumps or ends are added, since a pulse may lie between two random times, and those of brief contacts.

    - `points`: points of the set's box [P D].
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


def split_part(part: SetPart, scenario: Scenario, motion: StateSequence) -> list[Members]:
    """Return the two halves of a part, divided along the axis that changes K most; none if no axis changes K."""
    members, few = part.members, motion.every(16)
    acting = members.inertial()
    if not acting:
        return []
    points = np.full((2 * len(acting), len(members.axes)), 0.5)
    for row, axis in enumerate(acting):
        points[2 * row, axis], points[2 * row + 1, axis] = 0.0, 1.0
    mass = NominalModel.of(scenario, members.plant).mass_and_bias(few.t, few.q, few.dq)[0]
    ratios = np.linalg.solve(rigid_body_torque(members.plants(points), few)[0], mass[None])
    changes = np.abs(ratios[1::2] - ratios[::2]).max(axis=(1, 2, 3))
    if not changes.max() > 0.0:
        return []
    axis = acting[int(np.argmax(changes))]
    return [members.within(axis, low, low + 0.5) for low in (0.0, 0.5)]


def _enclosure(
    plants: list[Plant], hull: Hull, belief: NominalModel, motion: StateSequence
) -> tuple[Floats, Floats] | None:
    """Return lower and upper bounds of K's entries over all members [N n n] each; None if |A| is too large.

    With M = C + E and A = C⁻¹E, `K = (1 + A)⁻¹ C⁻¹M̂` differs from `C⁻¹M̂` by no more than `(1 - |A|)⁻¹ |A C⁻¹M̂|`,
    with the largest sizes in the hull. The bounds are interpolated between the evaluated samples.

    - `plants`, `hull`: one arm of each inertia, and their hull.
    """
    few = motion.every(max(1, len(motion.t) // STRIDE))
    nominal, _ = belief.mass_and_bias(few.t, few.q, few.dq)
    corners, effects = hull.of(rigid_body_torque(plants, few)[0])
    middle = corners.mean(axis=0)
    ratio = np.linalg.solve(middle, nominal)
    relative_corners = np.linalg.solve(middle[None], corners - middle)
    relative_effects = np.linalg.solve(middle[None], effects)
    size = np.abs(relative_corners).max(axis=0) + np.abs(relative_effects).sum(axis=0)
    first = np.abs(relative_corners @ ratio).max(axis=0) + np.abs(relative_effects @ ratio).sum(axis=0)
    if (np.abs(np.linalg.eigvals(size)).max(axis=1) >= LARGEST_RADIUS).any():
        return None
    difference = np.linalg.solve(np.eye(motion.joints) - size, first)
    return _interpolate(few.t, ratio - difference, motion.t), _interpolate(few.t, ratio + difference, motion.t)


def _range(plants: Sequence[Plant], beliefs: Sequence[NominalModel], motion: StateSequence) -> tuple[Floats, Floats]:
    """Return the least and the largest entries of K of some arms [N n n] each, interpolated between the evaluations."""
    few, n = motion.every(max(1, len(motion.t) // STRIDE)), motion.joints
    least = np.full((len(few.t), n, n), np.inf)
    most = -least
    for plant, belief in zip(plants, beliefs, strict=True):
        ratio = _ratio(plant, belief, few)
        least, most = np.minimum(least, ratio), np.maximum(most, ratio)
    return _interpolate(few.t, least, motion.t), _interpolate(few.t, most, motion.t)


def _slopes(arms: Sequence[tuple[Plant, NominalModel]], motion: StateSequence) -> Floats:
    """Return `SPARE` times the largest slopes of K's entries [N n n n] for the first, middle and last arm."""
    few, n = motion.every(max(1, len(motion.t) // (4 * STRIDE))), motion.joints
    slope = np.zeros((len(few.t), n, n, n))
    for k in sorted({0, len(arms) // 2, len(arms) - 1}):
        for joint in range(n):
            step = np.where(np.arange(n) == joint, STEP, 0.0)
            ends = [_ratio(*arms[k], few.shifted(sign * step, 0.0 * step)) for sign in (1.0, -1.0)]
            slope[..., joint] = np.maximum(slope[..., joint], np.abs(ends[0] - ends[1]) / (2.0 * STEP))
    return SPARE * _interpolate(few.t, slope, motion.t)


def _ratio(plant: Plant, belief: NominalModel, motion: StateSequence) -> Floats:
    nominal, _ = belief.mass_and_bias(motion.t, motion.q, motion.dq)
    return np.linalg.solve(rigid_body_torque([plant], motion)[0][0], nominal)


def _interpolate(times: Floats, values: Floats, at: Floats) -> Floats:
    """Return values at other times, linear between the given times and constant after the last."""
    before = np.searchsorted(times, at + 1e-9) - 1
    after = np.minimum(before + 1, len(times) - 1)
    share = np.where(after > before, (at - times[before]) / np.maximum(times[after] - times[before], 1e-12), 0.0)
    return values[before] + share.reshape(-1, *[1] * (values.ndim - 1)) * (values[after] - values[before])
