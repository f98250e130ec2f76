"""What is asked of an arm: a tool's pose, and among the postures that have it the nearest to one that is liked."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from .chain import Chain, Tool
from .curve import AbstractCurve, Aim
from .series import Array, Series, cross, dot, product, scaled, total, wide

Hold = Literal["place", "axis", "pose"]

HOLDS = {"place": 3, "axis": 5, "pose": 6}
"""What is asked of the tool, and how many numbers that are: its place, also where its z axis points, also its turn."""

BARRIER = 0.02
"""Weight of the limits of a redundant arm's joints, beside that of the posture."""

SEED, DRAWN = 0, 8
"""Postures at which it is seen how many ways a tool can move."""


@dataclass(frozen=True, eq=False)
class Task:
    """Least `½ Σ ((q - q_0)/w)²` among the postures with the tool where it should be.

    A redundant arm's posture is kept off the limits of its joints by a barrier, whose slope is 0 at q_0. So the posture
    is a smooth function of the tool's pose, and comes back with it.

    - `chain`: the joints.
    - `hold`: what is asked of the tool.
    - `posture`: q_0 [n], rad or m.
    - `widths`: w [n], half of each joint's range; 1 where it has no end.
    - `lower`, `upper`: of the joints [n]; infinite for an arm that is not redundant, whose posture is not free.
    - `damping`: how much of the tool's pose is given up near a singularity, m or rad per unit of force; 0 for nothing.
    """

    chain: Chain
    hold: Hold
    posture: Array
    widths: Array
    lower: Array
    upper: Array
    damping: float = 0.0

    def residual(self, q: Series, force: Series, aim: Aim) -> Series:
        """What is zero at the posture that is sought: the slope along what is free, and the tool's error.

        - `q`, `force`: posture and forces on the tool, series [... n], [... m].
        - `aim`: where the tool should be.
        """
        tool = self.chain.tool(q)
        pulled = self._pulled(tool, force, aim)
        off = total(self.error(tool, aim), scaled(force, -(self.damping**2)))
        return [_joined(a, b, q[0], force[0]) for a, b in zip(total(self._slope(q), pulled), off, strict=True)]

    def error(self, tool: Tool, aim: Aim) -> Series:
        """How far the tool is off, in m and, for small angles, rad, a series [... m].

        - `tool`: where it is.
        - `aim`: where it should be.
        """
        place = total(tool.place, scaled(aim.place, -1.0))
        if self.hold == "place":
            return place
        turned: Series
        if self.hold == "axis":
            tilts = [product(aim.y, tool.z, dot), scaled(product(aim.x, tool.z, dot), -1.0)]
            turned = [_stacked([tilt[k] for tilt in tilts]) for k in range(len(place))]
        else:
            pairs = zip((aim.x, aim.y, aim.z), (tool.x, tool.y, tool.z), strict=True)
            turned = scaled(total(*(product(a, b, cross) for a, b in pairs)), 0.5)
        return [_joined(a, b, place[0], turned[0]) for a, b in zip(place, turned, strict=True)]

    def _pulled(self, tool: Tool, force: Series, aim: Aim) -> Series:
        """The forces on the joints of a force on the tool, a series [... n]."""
        pull = [None if one is None else one[..., :3] for one in force]
        moment: Series = scaled(pull, 0.0)
        if self.hold == "pose":
            moment = [None if one is None else one[..., 3:] for one in force]
        if self.hold == "axis":
            first, second = ([None if one is None else one[..., k] for one in force] for k in (3, 4))
            about = total(product(first, aim.y, wide), scaled(product(second, aim.x, wide), -1.0))
            moment = product(tool.z, about, cross)
        found: dict[int, Series] = {}
        for axis in tool.axes:
            if axis.turns:
                arm = total(tool.place, scaled(axis.place, -1.0))
                about = product(arm, pull, cross)
                found[axis.joint] = product(axis.direction, total(about, moment), dot)
            else:
                found[axis.joint] = product(axis.direction, pull, dot)
        zero = np.zeros(force[0].shape[:-1])
        each = range(self.posture.size)
        return [
            np.stack([zero if j not in found or found[j][k] is None else found[j][k] + zero for j in each], axis=-1)
            for k in range(len(force))
        ]

    def _slope(self, q: Series) -> Series:
        """How fast what is to be least grows with each joint, a series [... n]."""
        slope = (q[0] - self.posture) / self.widths**2
        slope = slope + BARRIER * (self._wall(q[0])[0] - self._wall(self.posture)[0])
        found: Series = [slope]
        if len(q) > 1:
            _, once, twice = self._wall(q[0])
            stiffness = 1.0 / self.widths**2 + BARRIER * once
            with np.errstate(invalid="ignore"):
                found.append(None if q[1] is None else stiffness * q[1])
            if len(q) > 2:
                bent = 0.0 if q[1] is None else 0.5 * BARRIER * twice * q[1] ** 2
                found.append(bent + (0.0 if q[2] is None else stiffness * q[2]))
        return found

    def _wall(self, q: Array) -> tuple[Array, Array, Array]:
        """The slope of `-log((q - lower)(upper - q))`, with its first and second derivative."""
        # At a limit itself it is infinite, and there the search ends.
        with np.errstate(divide="ignore", invalid="ignore"):
            up, down = 1.0 / (self.upper - q), 1.0 / (q - self.lower)
            return up - down, up**2 + down**2, 2.0 * (up**3 - down**3)


class Linearised(NamedTuple):
    """The residual at some points of a curve, with what solves for the next.

    - `residual`: [k n+m].
    - `by_z`: its derivative [k n+m n+m].
    - `by_s`: that along the curve [k n+m].
    """

    residual: Array
    by_z: Array
    by_s: Array


def linearised(task: Task, curve: AbstractCurve, z: Array, s: Array) -> Linearised:
    """The residual and its derivatives at points of a curve.

    - `task`: what is asked.
    - `curve`: where the tool should be.
    - `z`: postures and forces [k n+m].
    - `s`: where on the curve [k].
    """
    n, size = task.posture.size, z.shape[1]
    # One direction for each unknown, and the last for the curve.
    directions = np.concatenate([np.eye(size), np.zeros((1, size))])
    moves = np.append(np.zeros(size), 1.0)
    shape = (len(z), size + 1)
    values = np.broadcast_to(z[:, None], (*shape, size))
    slopes = np.broadcast_to(directions, (*shape, size))
    aim = curve.aim([np.broadcast_to(s[:, None], shape), np.broadcast_to(moves, shape)])
    value, slope = task.residual([values[..., :n], slopes[..., :n]], [values[..., n:], slopes[..., n:]], aim)
    return Linearised(value[:, 0], np.swapaxes(slope[:, :-1], 1, 2), slope[:, -1])


def curvature(task: Task, curve: AbstractCurve, z: Array, s: Array, along: Array) -> Array:
    """The second derivative of the residual where z moves with a slope, [k n+m].

    - `task`, `curve`, `z`, `s`: as in `linearised`.
    - `along`: the slope `dz/ds` [k n+m].
    """
    n = task.posture.size
    aim = curve.aim([s, np.ones_like(s), None])
    *_, second = task.residual([z[:, :n], along[:, :n], None], [z[:, n:], along[:, n:], None], aim)
    return 2.0 * second


def tool_errors(task: Task, curve: AbstractCurve, q: Array, s: Array) -> tuple[Array, Array]:
    """How far the tool is off, [k] m and [k] rad; the angle is that of what is asked, 0 for its place alone.

    - `task`, `curve`: as in `linearised`.
    - `q`: postures [k n].
    - `s`: where on the curve [k].
    """
    (rotation, place), (there, aim) = task.chain.frame(q), curve.at(s)
    return apart(rotation, place, there, aim, task.hold)


def apart(rotation: Array, place: Array, there: Array, aim: Array, hold: Hold) -> tuple[Array, Array]:
    """How far two poses are from each other, m and rad; the angle is that of what is asked.

    - `rotation`, `place`: of the one [... 3 3], [... 3].
    - `there`, `aim`: of the other.
    - `hold`: what is asked.
    """
    off: Array = np.linalg.norm(place - aim, axis=-1)
    if hold == "place":
        return off, np.zeros_like(off)
    # By differences, which keep the digits of a small angle.
    difference, share = (rotation - there, 8.0) if hold == "pose" else ((rotation - there)[..., 2:], 4.0)
    size = np.sqrt(np.sum(difference**2, axis=(-2, -1)) / share)
    return off, 2.0 * np.arcsin(np.minimum(size, 1.0))


def jacobian(task: Task, q: Array) -> Array:
    """How the tool moves with the joints, in what is asked of it, [... m n].

    - `task`: what is asked.
    - `q`: postures [... n].
    """
    n = q.shape[-1]
    values = np.broadcast_to(q[..., None, :], (*q.shape[:-1], n, n))
    tool = task.chain.tool([values, np.broadcast_to(np.eye(n), values.shape)])
    aim = Aim(*([axis[0], None] for axis in (tool.x, tool.y, tool.z, tool.place)))
    slope = task.error(tool, aim)[1]
    return np.swapaxes(slope, -1, -2)


def least_motion(task: Task, q: Array) -> Array:
    """How the tool moves in its worst direction, of those in which it can, [...], m or rad.

    - `task`: what is asked.
    - `q`: postures [... n].
    """
    return np.linalg.svd(jacobian(task, q), compute_uv=False)[..., ways(task) - 1]


def ways(task: Task) -> int:
    """In how many ways the tool can move, of what is asked of it.

    - `task`: what is asked.
    """
    postures = task.posture + np.random.default_rng(SEED).uniform(-1.0, 1.0, (DRAWN, task.posture.size))
    return int(np.linalg.matrix_rank(jacobian(task, postures), tol=1e-6).max())


def _joined(a: Array | None, b: Array | None, like_a: Array, like_b: Array) -> Array | None:
    if a is None and b is None:
        return None
    return np.concatenate(
        [np.zeros_like(like_a) if a is None else a, np.zeros_like(like_b) if b is None else b], axis=-1
    )


def _stacked(terms: list[Array | None]) -> Array | None:
    known = [term for term in terms if term is not None]
    if not known:
        return None
    return np.stack([np.zeros_like(known[0]) if term is None else term for term in terms], axis=-1)
