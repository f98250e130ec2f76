"""Inverse kinematics as equations: the tool's pose, and a preferred posture for a redundant arm."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from .chain import Chain, Tool
from .curve import AbstractCurve, Aim
from .series import Array, Series, cross, dot, product, scaled, total, wide

Hold = Literal["place", "axis", "pose"]

HOLDS = {"place": 3, "axis": 5, "pose": 6}
"""Held coordinates of the tool and their number: position, also direction of the z axis, or the whole pose."""

BARRIER = 0.02
"""Weight of the limits of a redundant arm's joints, relative to that of the posture."""

SEED, DRAWN = 0, 8
"""Seed and number of random postures for the Jacobian's rank."""


@dataclass(frozen=True, eq=False)
class Task:
    """Minimise `½ Σ ((q - q_0)/w)²` among the postures that have the tool at its target.

    A barrier, whose slope is 0 at q_0, keeps a redundant arm's joints inside their limits. The posture is therefore a
    smooth function of the tool's pose: a closed path of the tool is a closed path of the joints.

    - `hold`: the coordinates of the tool that are prescribed.
    - `posture`: q_0 [n], rad or m.
    - `widths`: w [n], half of each joint's range; 1 for a joint without limits.
    - `lower`, `upper`: joint limits [n]; infinite for an arm that is not redundant.
    - `damping`: pose error accepted near a singularity, m or rad per unit of force; 0 for none.
    """

    chain: Chain
    hold: Hold
    posture: Array
    widths: Array
    lower: Array
    upper: Array
    damping: float = 0.0

    def residual(self, q: Series, force: Series, aim: Aim) -> Series:
        """Return the equations' residual: the slope along the free directions, and the tool's error.

        - `q`, `force`: posture and forces on the tool, series [... n], [... m].
        """
        tool = self.chain.tool(q)
        pulled = self._pulled(tool, force, aim)
        off = total(self.error(tool, aim), scaled(force, -(self.damping**2)))
        return [_joined(a, b, q[0], force[0]) for a, b in zip(total(self._slope(q), pulled), off, strict=True)]

    def error(self, tool: Tool, aim: Aim) -> Series:
        """Return the tool's error in m and, for small angles, rad, a series [... m]."""
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
        """Joint forces from a force on the tool, a series [... n]."""
        pull = [None if c is None else c[..., :3] for c in force]
        moment: Series = scaled(pull, 0.0)
        if self.hold == "pose":
            moment = [None if c is None else c[..., 3:] for c in force]
        if self.hold == "axis":
            first, second = ([None if c is None else c[..., k] for c in force] for k in (3, 4))
            about = total(product(first, aim.y, wide), scaled(product(second, aim.x, wide), -1.0))
            moment = product(tool.z, about, cross)
        torques: dict[int, Series] = {}
        for axis in tool.axes:
            if axis.turns:
                arm = total(tool.place, scaled(axis.place, -1.0))
                about = product(arm, pull, cross)
                torques[axis.joint] = product(axis.direction, total(about, moment), dot)
            else:
                torques[axis.joint] = product(axis.direction, pull, dot)
        zero = np.zeros(force[0].shape[:-1])
        each = range(self.posture.size)
        return [
            np.stack(
                [zero if j not in torques or torques[j][k] is None else torques[j][k] + zero for j in each], axis=-1
            )
            for k in range(len(force))
        ]

    def _slope(self, q: Series) -> Series:
        """Gradient of the minimised function, a series [... n]."""
        slope = (q[0] - self.posture) / self.widths**2
        slope = slope + BARRIER * (self._wall(q[0])[0] - self._wall(self.posture)[0])
        series: Series = [slope]
        if len(q) > 1:
            _, once, twice = self._wall(q[0])
            stiffness = 1.0 / self.widths**2 + BARRIER * once
            with np.errstate(invalid="ignore"):
                series.append(None if q[1] is None else stiffness * q[1])
            if len(q) > 2:
                bent = 0.0 if q[1] is None else 0.5 * BARRIER * twice * q[1] ** 2
                series.append(bent + (0.0 if q[2] is None else stiffness * q[2]))
        return series

    def _wall(self, q: Array) -> tuple[Array, Array, Array]:
        """Slope of the barrier `-log((q - lower)(upper - q))`, with its first and second derivative."""
        # At a limit itself it is infinite, and there the search ends.
        with np.errstate(divide="ignore", invalid="ignore"):
            up, down = 1.0 / (self.upper - q), 1.0 / (q - self.lower)
            return up - down, up**2 + down**2, 2.0 * (up**3 - down**3)


class Linearised(NamedTuple):
    """Residual at points of a curve [k n+m], with its derivatives by z [k n+m n+m] and along the curve [k n+m]."""

    residual: Array
    by_z: Array
    by_s: Array


def linearised(task: Task, curve: AbstractCurve, z: Array, s: Array) -> Linearised:
    """Return the residual and its derivatives at points of a curve.

    - `z`: postures and forces [k n+m].
    - `s`: curve parameters [k].
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
    """Return the residual's second derivative where z has the slope `along` [k n+m]."""
    n = task.posture.size
    aim = curve.aim([s, np.ones_like(s), None])
    *_, second = task.residual([z[:, :n], along[:, :n], None], [z[:, n:], along[:, n:], None], aim)
    return 2.0 * second


def tool_errors(task: Task, curve: AbstractCurve, q: Array, s: Array) -> tuple[Array, Array]:
    """Return the tool's errors at postures q [k n], [k] m and [k] rad; the angle is 0 if only the position is held."""
    (rotation, place), (there, aim) = task.chain.frame(q), curve.at(s)
    return apart(rotation, place, there, aim, task.hold)


def apart(rotation: Array, place: Array, there: Array, aim: Array, hold: Hold) -> tuple[Array, Array]:
    """Return the distance between two poses, m and rad, in the held coordinates.

    - `rotation`, `place`: first pose [... 3 3], [... 3].
    - `there`, `aim`: second pose.
    """
    off: Array = np.linalg.norm(place - aim, axis=-1)
    if hold == "place":
        return off, np.zeros_like(off)
    # By differences, which keep the digits of a small angle.
    difference, share = (rotation - there, 8.0) if hold == "pose" else ((rotation - there)[..., 2:], 4.0)
    size = np.sqrt(np.sum(difference**2, axis=(-2, -1)) / share)
    return off, 2.0 * np.arcsin(np.minimum(size, 1.0))


def jacobian(task: Task, q: Array) -> Array:
    """Return the Jacobian of the held coordinates [... m n] at postures [... n]."""
    n = q.shape[-1]
    values = np.broadcast_to(q[..., None, :], (*q.shape[:-1], n, n))
    tool = task.chain.tool([values, np.broadcast_to(np.eye(n), values.shape)])
    aim = Aim(*([axis[0], None] for axis in (tool.x, tool.y, tool.z, tool.place)))
    slope = task.error(tool, aim)[1]
    return np.swapaxes(slope, -1, -2)


def least_motion(task: Task, q: Array) -> Array:
    """Return the least singular value of the Jacobian at postures [... n], in m or rad per rad or m of the joints.

    Directions in which the tool can never move, such as out of a planar arm's plane, do not count.
    """
    return np.linalg.svd(jacobian(task, q), compute_uv=False)[..., ways(task) - 1]


def ways(task: Task) -> int:
    """Return the number of held coordinates that the joints can move: the Jacobian's largest rank."""
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
