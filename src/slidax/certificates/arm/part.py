"""A part of a set of arms: how its members move each joint with the others, and what they ask of the loops."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from slidax.scenarios import Scenario
from slidax.simulation import Plant

from .demand import probed
from .evaluated import Floats
from .hull import hull_of
from .members import Members
from .motion import Belief, Motion, kinds_of, needed, outer

MOST_ARMS = 33
"""Members at ends of what changes the inertia."""

STRIDE = 8
"""Samples from one K that is computed to the next; to the next slope of it four times as many."""

STEP = 1e-4
"""Of a central difference [rad or m]."""

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
    - `arms`: of how many members.
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
        ratios = _ratios([arm for arm, _ in seen], [known for _, known in seen], motion)
        return Part(members, push, np.zeros((0, *motion.q.shape)), *ratios, len(seen))
    belief = Belief.of(scenario, members.plant)
    hull = hull_of(lambda points: probed(members, points, scenario), len(members.axes))
    plants = members.plants(hull.points)
    mass, bias = belief.mass_and_bias(motion.t, motion.q, motion.dq)
    believed = np.einsum("kij,kj->ki", mass, motion.ddq) + bias + belief.friction(motion.t, motion.wanted_dq)
    kinds, which = kinds_of(plants)
    lacks = believed - needed(kinds, motion)[1][which] + outer(plants, motion)
    corners, effects = hull.of(np.linalg.solve(mass[None], lacks[..., None])[..., 0])
    arms, _ = kinds_of(members.plants(members.ends(hull.without)))
    ratios = _ratios(arms[:MOST_ARMS], [belief] * len(arms[:MOST_ARMS]), motion)
    return Part(members, corners, effects, *ratios, len(arms[:MOST_ARMS]))


def halves(part: Part, scenario: Scenario, motion: Motion) -> list[Members]:
    """The two halves of a part in the number that K depends on most; none if it depends on none.

    - `part`: whose.
    - `scenario`: of the set.
    - `motion`: along which.
    """
    members, few = part.members, motion.every(16)
    acting = [k for k in range(len(members.axes)) if members.is_inertial(k)]
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


def _ratios(plants: Sequence[Plant], beliefs: Sequence[Belief], motion: Motion) -> tuple[Floats, Floats, Floats]:
    """The least and the largest of the entries of K [N n n], and of their slopes [N n n n].

    Linear between the samples at which they are computed; slopes are those of the first, middle and last member, by
    central differences, with half as much again.
    """
    few, n = motion.every(max(1, len(motion.t) // STRIDE)), motion.joints
    least = np.full((len(few.t), n, n), np.inf)
    most = -least
    for plant, belief in zip(plants, beliefs, strict=True):
        ratio = _ratio(plant, belief, few)
        least, most = np.minimum(least, ratio), np.maximum(most, ratio)
    fewer = motion.every(max(1, len(motion.t) // (4 * STRIDE)))
    slope = np.zeros((len(fewer.t), n, n, n))
    for k in sorted({0, len(plants) // 2, len(plants) - 1}):
        for joint in range(n):
            step = np.where(np.arange(n) == joint, STEP, 0.0)
            ends = [_ratio(plants[k], beliefs[k], fewer.beside(sign * step, 0.0 * step)) for sign in (1.0, -1.0)]
            slope[..., joint] = np.maximum(slope[..., joint], np.abs(ends[0] - ends[1]) / (2.0 * STEP))
    return _between(few.t, least, motion.t), _between(few.t, most, motion.t), SPARE * _between(fewer.t, slope, motion.t)


def _ratio(plant: Plant, belief: Belief, motion: Motion) -> Floats:
    believed, _ = belief.mass_and_bias(motion.t, motion.q, motion.dq)
    found: Floats = np.linalg.solve(needed([plant], motion)[0][0], believed)
    return found


def _between(times: Floats, values: Floats, at: Floats) -> Floats:
    """Values at other times, on the lines between those that are given; the last one after them."""
    before = np.searchsorted(times, at + 1e-9) - 1
    after = np.minimum(before + 1, len(times) - 1)
    share = np.where(after > before, (at - times[before]) / np.maximum(times[after] - times[before], 1e-12), 0.0)
    found: Floats = values[before] + share.reshape(-1, *[1] * (values.ndim - 1)) * (values[after] - values[before])
    return found
