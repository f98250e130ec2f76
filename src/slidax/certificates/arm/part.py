"""A part of an uncertainty set: its disturbances, and the coupling between joints, along a motion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from slidax.scenarios import Scenario
from slidax.simulation import Plant

from ..each import Floats
from .hull import Hull, hull_of
from .members import Members
from .motion import Belief, Motion, breakpoints, kinds_of, needed, outer

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
class Part:
    """Some members of a set along a motion.

    - `push`: w* of each extreme member [M N n], rad/s² or m/s²; `effects`: its change by half the width of an uncertain
      value [E N n].
    - `low`, `high`: the least and the largest of each entry of `K = M⁻¹M̂` [N n n].
    - `slope`: bounds of |∂K_ij/∂q_l| along the motion [N n n n].
    - `arms`: number of members evaluated for K; 0 if K is enclosed for all of the part.
    """

    members: Members
    push: Floats
    effects: Floats
    low: Floats
    high: Floats
    slope: Floats
    arms: int

    def shrunk(self, share: float, push: Floats) -> Part:
        """The part scaled around its middle.

        - `push`: w* of the middle [N n].
        """
        middle = 0.5 * (self.low + self.high)
        low, high = (middle + share * (side - middle) for side in (self.low, self.high))
        return Part(
            self.members, push + share * (self.push - push), share * self.effects, low, high, self.slope, self.arms
        )


def part_of(
    scenario: Scenario, members: Members, motion: Motion, cases: Sequence[tuple[Plant, Belief]], push: Floats | None
) -> Part:
    """Return a part of a scenario's set along a motion.

    - `cases`: for a law that learns, arms with their learned models, and `push` w* of these.
    """
    if cases and push is not None:
        low, high = _range([arm for arm, _ in cases], [known for _, known in cases], motion)
        slope = _slopes(cases, motion)
        return Part(members, push, np.zeros((0, *motion.q.shape)), low, high, slope, len(cases))
    belief = Belief.of(scenario, members.plant)
    hull = hull_of(lambda points: probed(members, points), len(members.axes))
    plants = members.plants(hull.points)
    mass, bias = belief.mass_and_bias(motion.t, motion.q, motion.dq)
    believed = np.einsum("kij,kj->ki", mass, motion.ddq) + bias + belief.friction(motion.t, motion.wanted_dq)
    kinds, which = kinds_of(plants)
    lacks = believed - needed(kinds, motion)[1][which] + outer(plants, motion)
    corners, effects = hull.of(np.linalg.solve(mass[None], lacks[..., None])[..., 0])
    arms, _ = kinds_of(members.plants(members.ends(hull.without)))
    slope = _slopes([(arm, belief) for arm in (arms[0], arms[len(arms) // 2], arms[-1])], motion)
    within = _enclosed(kinds, hull.merged(which), belief, motion)
    if within is not None:
        return Part(members, corners, effects, *within, slope, 0)
    return Part(members, corners, effects, *_range(arms, [belief] * len(arms), motion), slope, len(arms))


def probed(members: Members, points: Floats) -> Floats:
    """Return the torques of members at random states and at some of the motion [P F].

    The times are random, so that a ripple vanishes at all of them only by accident. Added are the times at which a
    force starts, jumps or ends, since a pulse may lie between all others, and those of brief contacts.

    - `points`: of the set's box [P D].
    """
    random = np.random.default_rng(0)
    motion, plants = Motion.of(members.scenario), members.plants(points)
    end = members.scenario.t1
    jumps = breakpoints(plants, end)
    pulses = jumps[:-1] + 0.5 * np.diff(jumps)
    t = np.concatenate([np.sort(random.uniform(0.0, end, PROBES)), jumps, pulses, members.brief])
    few = motion.at(t, instants=1)
    drawn = np.random.default_rng(1).normal(size=(3, PROBES, motion.joints))
    count = len(few.t)
    q, dq, ddq = (np.resize(values, (count, motion.joints)) for values in drawn)
    states = Motion(
        np.concatenate([few.t, few.t]),
        np.concatenate([q, few.q]),
        np.concatenate([dq, few.dq]),
        np.concatenate([ddq, few.ddq]),
    )
    kinds, which = kinds_of(plants)
    torque = needed(kinds, states)[1][which] - outer(plants, states)
    return torque.reshape(len(points), -1)


def halves(part: Part, scenario: Scenario, motion: Motion) -> list[Members]:
    """Return the two halves of a part, divided at the value that changes K most; none if no value changes K."""
    members, few = part.members, motion.every(16)
    acting = members.inertial()
    if not acting:
        return []
    points = np.full((2 * len(acting), len(members.axes)), 0.5)
    for row, axis in enumerate(acting):
        points[2 * row, axis], points[2 * row + 1, axis] = 0.0, 1.0
    mass = Belief.of(scenario, members.plant).mass_and_bias(few.t, few.q, few.dq)[0]
    ratios = np.linalg.solve(needed(members.plants(points), few)[0], mass[None])
    moved = np.abs(ratios[1::2] - ratios[::2]).max(axis=(1, 2, 3))
    if not moved.max() > 0.0:
        return []
    axis = acting[int(np.argmax(moved))]
    return [members.within(axis, low, low + 0.5) for low in (0.0, 0.5)]


def _enclosed(plants: list[Plant], hull: Hull, belief: Belief, motion: Motion) -> tuple[Floats, Floats] | None:
    """Range of the entries of K over all members [N n n] each; None if they are too far apart for a bound.

    With M = C + E and A = C⁻¹E, `K = (1 + A)⁻¹ C⁻¹M̂` differs from `C⁻¹M̂` by no more than `(1 - |A|)⁻¹ |A C⁻¹M̂|`,
    with the largest sizes in the hull. Linear between the evaluated samples.

    - `plants`, `hull`: one arm of each inertia, and their hull.
    """
    few = motion.every(max(1, len(motion.t) // STRIDE))
    believed, _ = belief.mass_and_bias(few.t, few.q, few.dq)
    corners, effects = hull.of(needed(plants, few)[0])
    middle = corners.mean(axis=0)
    ratio = np.linalg.solve(middle, believed)
    off, parts = np.linalg.solve(middle[None], corners - middle), np.linalg.solve(middle[None], effects)
    size = np.abs(off).max(axis=0) + np.abs(parts).sum(axis=0)
    first = np.abs(off @ ratio).max(axis=0) + np.abs(parts @ ratio).sum(axis=0)
    if (np.abs(np.linalg.eigvals(size)).max(axis=1) >= FARTHEST).any():
        return None
    reach = np.linalg.solve(np.eye(motion.joints) - size, first)
    return _between(few.t, ratio - reach, motion.t), _between(few.t, ratio + reach, motion.t)


def _range(plants: Sequence[Plant], beliefs: Sequence[Belief], motion: Motion) -> tuple[Floats, Floats]:
    """Range of the entries of K of some arms [N n n] each, linear between the evaluated samples."""
    few, n = motion.every(max(1, len(motion.t) // STRIDE)), motion.joints
    least = np.full((len(few.t), n, n), np.inf)
    most = -least
    for plant, belief in zip(plants, beliefs, strict=True):
        ratio = _ratio(plant, belief, few)
        least, most = np.minimum(least, ratio), np.maximum(most, ratio)
    return _between(few.t, least, motion.t), _between(few.t, most, motion.t)


def _slopes(arms: Sequence[tuple[Plant, Belief]], motion: Motion) -> Floats:
    """Slopes of K's entries [N n n n], of the first, middle and last of some arms, times `SPARE`."""
    few, n = motion.every(max(1, len(motion.t) // (4 * STRIDE))), motion.joints
    slope = np.zeros((len(few.t), n, n, n))
    for k in sorted({0, len(arms) // 2, len(arms) - 1}):
        for joint in range(n):
            step = np.where(np.arange(n) == joint, STEP, 0.0)
            ends = [_ratio(*arms[k], few.shifted(sign * step, 0.0 * step)) for sign in (1.0, -1.0)]
            slope[..., joint] = np.maximum(slope[..., joint], np.abs(ends[0] - ends[1]) / (2.0 * STEP))
    return SPARE * _between(few.t, slope, motion.t)


def _ratio(plant: Plant, belief: Belief, motion: Motion) -> Floats:
    believed, _ = belief.mass_and_bias(motion.t, motion.q, motion.dq)
    return np.linalg.solve(needed([plant], motion)[0][0], believed)


def _between(times: Floats, values: Floats, at: Floats) -> Floats:
    """Values at other times by linear interpolation; the last one after them."""
    before = np.searchsorted(times, at + 1e-9) - 1
    after = np.minimum(before + 1, len(times) - 1)
    share = np.where(after > before, (at - times[before]) / np.maximum(times[after] - times[before], 1e-12), 0.0)
    return values[before] + share.reshape(-1, *[1] * (values.ndim - 1)) * (values[after] - values[before])
