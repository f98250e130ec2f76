"""A part of a set of arms: how its members move each joint with the others, and what they ask of the loops."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from slidax.scenarios import Scenario
from slidax.simulation import Plant

from .demand import probed
from .evaluated import Floats
from .hull import Hull, hull_of
from .members import Members
from .motion import Belief, Motion, kinds_of, needed, outer

STRIDE = 8
"""Samples from one K that is computed to the next; to the next slope of it four times as many."""

STEP = 1e-4
"""Of a central difference [rad or m]."""

FARTHEST = 0.8
"""Modulus of |A| up to which K is enclosed."""

SPARE = 1.5
"""Times a slope, for members and instants between those that are looked at."""


@dataclass(frozen=True, eq=False)
class Part:
    """Some members of a set along a motion.

    - `members`: which.
    - `push`: w* of each extreme one [M N n], rad/s² or m/s²; `effects`: what half the width of an uncertain number adds
      [E N n].
    - `low`, `high`: the least and the largest of each entry of `K = M⁻¹M̂` [N n n].
    - `slope`: bounds of |∂K_ij/∂q_l| along it [N n n n].
    - `arms`: how many members were looked at for K; 0 if it is enclosed for all of the part.
    """

    members: Members
    push: Floats
    effects: Floats
    low: Floats
    high: Floats
    slope: Floats
    arms: int

    def shrunk(self, share: float, push: Floats) -> Part:
        """The same of a set that is so many times as large around its middle.

        - `share`: of each of its numbers.
        - `push`: w* of the middle [N n].
        """
        middle = 0.5 * (self.low + self.high)
        low, high = (middle + share * (side - middle) for side in (self.low, self.high))
        return Part(
            self.members, push + share * (self.push - push), share * self.effects, low, high, self.slope, self.arms
        )


def part_of(
    scenario: Scenario, members: Members, motion: Motion, seen: Sequence[tuple[Plant, Belief]], push: Floats | None
) -> Part:
    """What a part of a scenario's set is along a motion.

    - `scenario`: whose.
    - `members`: of the part.
    - `motion`: along which.
    - `seen`: for a law that learns, arms with what it came to believe of each, and `push` w* of these.
    """
    if seen and push is not None:
        low, high = _range([arm for arm, _ in seen], [known for _, known in seen], motion)
        slope = _slopes(seen, motion)
        return Part(members, push, np.zeros((0, *motion.q.shape)), low, high, slope, len(seen))
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


def halves(part: Part, scenario: Scenario, motion: Motion) -> list[Members]:
    """The two halves of a part in the number that K depends on most; none if it depends on none.

    - `part`: whose.
    - `scenario`: of the set.
    - `motion`: along which.
    """
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
    """Ends of the entries of K for all members [N n n] each; None where they are too far apart for a bound.

    With M = C + E and A = C⁻¹E, `K = (1 + A)⁻¹ C⁻¹M̂` is off `C⁻¹M̂` by no more than `(1 - |A|)⁻¹ |A C⁻¹M̂|`, where both
    sizes are the largest of the hull. Linear between the samples at which it is computed.

    - `plants`, `hull`: one arm of each inertia, and the hull of these.
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
    """The least and the largest of the entries of K of some arms [N n n] each, linear between some samples."""
    few, n = motion.every(max(1, len(motion.t) // STRIDE)), motion.joints
    least = np.full((len(few.t), n, n), np.inf)
    most = -least
    for plant, belief in zip(plants, beliefs, strict=True):
        ratio = _ratio(plant, belief, few)
        least, most = np.minimum(least, ratio), np.maximum(most, ratio)
    return _between(few.t, least, motion.t), _between(few.t, most, motion.t)


def _slopes(arms: Sequence[tuple[Plant, Belief]], motion: Motion) -> Floats:
    """The slopes of K's entries [N n n n], of the first, middle and last of some arms, with half as much again."""
    few, n = motion.every(max(1, len(motion.t) // (4 * STRIDE))), motion.joints
    slope = np.zeros((len(few.t), n, n, n))
    for k in sorted({0, len(arms) // 2, len(arms) - 1}):
        for joint in range(n):
            step = np.where(np.arange(n) == joint, STEP, 0.0)
            ends = [_ratio(*arms[k], few.beside(sign * step, 0.0 * step)) for sign in (1.0, -1.0)]
            slope[..., joint] = np.maximum(slope[..., joint], np.abs(ends[0] - ends[1]) / (2.0 * STEP))
    return SPARE * _between(few.t, slope, motion.t)


def _ratio(plant: Plant, belief: Belief, motion: Motion) -> Floats:
    believed, _ = belief.mass_and_bias(motion.t, motion.q, motion.dq)
    return np.linalg.solve(needed([plant], motion)[0][0], believed)


def _between(times: Floats, values: Floats, at: Floats) -> Floats:
    """Values at other times, on the lines between those that are given; the last one after them."""
    before = np.searchsorted(times, at + 1e-9) - 1
    after = np.minimum(before + 1, len(times) - 1)
    share = np.where(after > before, (at - times[before]) / np.maximum(times[after] - times[before], 1e-12), 0.0)
    return values[before] + share.reshape(-1, *[1] * (values.ndim - 1)) * (values[after] - values[before])
