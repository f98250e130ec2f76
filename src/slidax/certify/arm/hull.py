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


def convex_hull(evaluate: Callable[[Floats], Floats], dimensions: int) -> Hull:
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


STRIDE = 8
"""Samples between two evaluations of K; its slopes are evaluated at every fourth of these."""

STEP = 1e-4
"""Step of a central difference, rad or m."""

FARTHEST = 0.8
"""Modulus of |A| up to which K is enclosed."""

PROBES = 48
"""Number of random states, and of states of the motion, that show how the values of a set enter."""

SPARE = 1.5
"""Factor of a slope, for members and instants between the evaluated ones."""


@dataclass(frozen=True, eq=False)
class SetPart:
    """Some members of a set along a motion.

    - `disturbance`: w* of each extreme member [M N n], rad/s² or m/s².
    - `effects`: its change by half the width of an uncertain value [E N n], rad/s² or m/s².
    - `low`, `high`: the least and the largest of each entry of `K = M⁻¹M̂` [N n n].
    - `slope`: bounds of |∂K_ij/∂q_l| along the motion [N n n n].
    - `arms`: number of members evaluated for K; 0 if K is enclosed for all of the part.
    """

    members: Members
    disturbance: Floats
    effects: Floats
    low: Floats
    high: Floats
    slope: Floats
    arms: int

    def shrunk(self, share: float, disturbance: Floats) -> SetPart:
        """The part scaled around its middle.

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

    - `cases`: for a law that learns, arms with their learned models, and `disturbance` w* of these.
    """
    if cases and disturbance is not None:
        low, high = _range([arm for arm, _ in cases], [known for _, known in cases], motion)
        slope = _slopes(cases, motion)
        return SetPart(members, disturbance, np.zeros((0, *motion.q.shape)), low, high, slope, len(cases))
    belief = NominalModel.of(scenario, members.plant)
    hull = convex_hull(lambda points: probe_torques(members, points), len(members.axes))
    plants = members.plants(hull.points)
    mass, bias = belief.mass_and_bias(motion.t, motion.q, motion.dq)
    believed = np.einsum("kij,kj->ki", mass, motion.ddq) + bias + belief.friction(motion.t, motion.wanted_dq)
    kinds, which = distinct_inertias(plants)
    lacks = believed - rigid_body_torque(kinds, motion)[1][which] + outer_torque(plants, motion)
    corners, effects = hull.of(np.linalg.solve(mass[None], lacks[..., None])[..., 0])
    arms, _ = distinct_inertias(members.plants(members.ends(hull.without)))
    slope = _slopes([(arm, belief) for arm in (arms[0], arms[len(arms) // 2], arms[-1])], motion)
    within = _enclosed(kinds, hull.merged(which), belief, motion)
    if within is not None:
        return SetPart(members, corners, effects, *within, slope, 0)
    return SetPart(members, corners, effects, *_range(arms, [belief] * len(arms), motion), slope, len(arms))


def probe_torques(members: Members, points: Floats) -> Floats:
    """Return the torques of members at random states and at some of the motion [P F].

    The times are random, so that a ripple vanishes at all of them only by accident. Added are the times at which a
    force starts, jumps or ends, since a pulse may lie between all others, and those of brief contacts.

    - `points`: of the set's box [P D].
    """
    random = np.random.default_rng(0)
    motion, plants = StateSequence.of(members.scenario), members.plants(points)
    end = members.scenario.t1
    jumps = breakpoints(plants, end)
    pulses = jumps[:-1] + 0.5 * np.diff(jumps)
    t = np.concatenate([np.sort(random.uniform(0.0, end, PROBES)), jumps, pulses, members.brief])
    few = motion.at(t, instants=1)
    drawn = np.random.default_rng(1).normal(size=(3, PROBES, motion.joints))
    count = len(few.t)
    q, dq, ddq = (np.resize(values, (count, motion.joints)) for values in drawn)
    states = StateSequence(
        np.concatenate([few.t, few.t]),
        np.concatenate([q, few.q]),
        np.concatenate([dq, few.dq]),
        np.concatenate([ddq, few.ddq]),
    )
    kinds, which = distinct_inertias(plants)
    torque = rigid_body_torque(kinds, states)[1][which] - outer_torque(plants, states)
    return torque.reshape(len(points), -1)


def split_part(part: SetPart, scenario: Scenario, motion: StateSequence) -> list[Members]:
    """Return the two halves of a part, divided at the value that changes K most; none if no value changes K."""
    members, few = part.members, motion.every(16)
    acting = members.inertial()
    if not acting:
        return []
    points = np.full((2 * len(acting), len(members.axes)), 0.5)
    for row, axis in enumerate(acting):
        points[2 * row, axis], points[2 * row + 1, axis] = 0.0, 1.0
    mass = NominalModel.of(scenario, members.plant).mass_and_bias(few.t, few.q, few.dq)[0]
    ratios = np.linalg.solve(rigid_body_torque(members.plants(points), few)[0], mass[None])
    moved = np.abs(ratios[1::2] - ratios[::2]).max(axis=(1, 2, 3))
    if not moved.max() > 0.0:
        return []
    axis = acting[int(np.argmax(moved))]
    return [members.within(axis, low, low + 0.5) for low in (0.0, 0.5)]


def _enclosed(
    plants: list[Plant], hull: Hull, belief: NominalModel, motion: StateSequence
) -> tuple[Floats, Floats] | None:
    """Range of the entries of K over all members [N n n] each; None if they are too far apart for a bound.

    With M = C + E and A = C⁻¹E, `K = (1 + A)⁻¹ C⁻¹M̂` differs from `C⁻¹M̂` by no more than `(1 - |A|)⁻¹ |A C⁻¹M̂|`,
    with the largest sizes in the hull. Linear between the evaluated samples.

    - `plants`, `hull`: one arm of each inertia, and their hull.
    """
    few = motion.every(max(1, len(motion.t) // STRIDE))
    believed, _ = belief.mass_and_bias(few.t, few.q, few.dq)
    corners, effects = hull.of(rigid_body_torque(plants, few)[0])
    middle = corners.mean(axis=0)
    ratio = np.linalg.solve(middle, believed)
    off, parts = np.linalg.solve(middle[None], corners - middle), np.linalg.solve(middle[None], effects)
    size = np.abs(off).max(axis=0) + np.abs(parts).sum(axis=0)
    first = np.abs(off @ ratio).max(axis=0) + np.abs(parts @ ratio).sum(axis=0)
    if (np.abs(np.linalg.eigvals(size)).max(axis=1) >= FARTHEST).any():
        return None
    reach = np.linalg.solve(np.eye(motion.joints) - size, first)
    return _between(few.t, ratio - reach, motion.t), _between(few.t, ratio + reach, motion.t)


def _range(plants: Sequence[Plant], beliefs: Sequence[NominalModel], motion: StateSequence) -> tuple[Floats, Floats]:
    """Range of the entries of K of some arms [N n n] each, linear between the evaluated samples."""
    few, n = motion.every(max(1, len(motion.t) // STRIDE)), motion.joints
    least = np.full((len(few.t), n, n), np.inf)
    most = -least
    for plant, belief in zip(plants, beliefs, strict=True):
        ratio = _ratio(plant, belief, few)
        least, most = np.minimum(least, ratio), np.maximum(most, ratio)
    return _between(few.t, least, motion.t), _between(few.t, most, motion.t)


def _slopes(arms: Sequence[tuple[Plant, NominalModel]], motion: StateSequence) -> Floats:
    """Slopes of K's entries [N n n n], of the first, middle and last of some arms, times `SPARE`."""
    few, n = motion.every(max(1, len(motion.t) // (4 * STRIDE))), motion.joints
    slope = np.zeros((len(few.t), n, n, n))
    for k in sorted({0, len(arms) // 2, len(arms) - 1}):
        for joint in range(n):
            step = np.where(np.arange(n) == joint, STEP, 0.0)
            ends = [_ratio(*arms[k], few.shifted(sign * step, 0.0 * step)) for sign in (1.0, -1.0)]
            slope[..., joint] = np.maximum(slope[..., joint], np.abs(ends[0] - ends[1]) / (2.0 * STEP))
    return SPARE * _between(few.t, slope, motion.t)


def _ratio(plant: Plant, belief: NominalModel, motion: StateSequence) -> Floats:
    believed, _ = belief.mass_and_bias(motion.t, motion.q, motion.dq)
    return np.linalg.solve(rigid_body_torque([plant], motion)[0][0], believed)


def _between(times: Floats, values: Floats, at: Floats) -> Floats:
    """Values at other times by linear interpolation; the last one after them."""
    before = np.searchsorted(times, at + 1e-9) - 1
    after = np.minimum(before + 1, len(times) - 1)
    share = np.where(after > before, (at - times[before]) / np.maximum(times[after] - times[before], 1e-12), 0.0)
    return values[before] + share.reshape(-1, *[1] * (values.ndim - 1)) * (values[after] - values[before])
