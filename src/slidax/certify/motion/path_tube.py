"""Bounds of the arm's geometry over the cells of a motion and a tube around it.

Each quantity is known at the centre of a cell; its change over the cell and the tube is bounded by Taylor's theorem
with the derivatives of Y along the motion, which are exact at the centre, and by `‖∂_i … ∂_k Y x‖ <= B_k ‖x‖` for the
rest, with k the outermost joint of the derivative (body_points.py).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from .body_points import BodyPoints
from .path import Path
from .path_cells import PathCells
from .path_norms import PointNorms, size_in

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Tube:
    """Deviation of the arm and of the model's arguments from the motion in each cell; vectors [N n], norms [N].

    - `position`: position of the arm and of where the model is evaluated, |q - q_d|.
    - `speed`: |q̇ - q̇_d| of the arm; `model_speed`: of where the model is evaluated; `speed_norm`, `model_norm`: in
      the metric.
    - `command`: |s|; `command_norm`: in the metric. `acceleration`, `acceleration_norm`: of the arm's ë less s.
    """

    position: Floats
    speed: Floats
    speed_norm: Floats
    model_speed: Floats
    model_norm: Floats
    command: Floats
    command_norm: Floats
    acceleration: Floats
    acceleration_norm: Floats

    @classmethod
    def none(cls, cells: PathCells) -> Tube:
        """Return the tube of no width."""
        nothing = np.zeros_like(cells.speed)
        return cls(
            nothing, nothing, nothing[:, 0], nothing, nothing[:, 0], nothing, nothing[:, 0], nothing, nothing[:, 0]
        )


class PointCell:
    """A set of points over the cells and the tube around them, as norms in the metric of the centres.

    - `half`: half the length of a cell and half a period, since the model is evaluated up to that far from an instant.
    - `size`, `whole`: of Y, at the centre and in the cell. `first`, `second`, `third`: of its derivatives by time, on
      the motion. `drift`, `along`: change of Y by the tube, and altogether.
    - `grown`: factor of a vector's norm from the actual metric; `jump`, `jerk`: norms of the acceleration's jumps and
      of the jerk in it; `reach`: of Y in it. `Cell` sets these.
    """

    grown: Floats
    jump: Floats
    jerk: Floats
    reach: Floats

    def __init__(self, path: Path, at: PointNorms, tube: Tube) -> None:
        """Compute the norms."""
        self.path, self.tube, self.at = path, tube, at
        cells = path.cells
        self.half = half = cells.half + 0.5 * cells.period
        self.conversion = np.sqrt(np.diagonal(path.inverse, axis1=1, axis2=2))
        self.speed, self.acceleration = speed, acceleration = cells.speed, cells.acceleration
        place = tube.position
        self.outer, self.own = _outer(path.bodies, at, self.conversion, half * speed + place)
        sums = self.sums
        self.third = third = sums(speed, speed, speed) + 3.0 * sums(speed, acceleration) + sums(cells.jerk)
        jumps = sums(cells.jump)
        self.second = at.second + half * third + jumps
        self.first = first = at.first + half * (at.second + jumps) + 0.5 * half**2 * third
        self.drift = drift = sums(place)
        self.along = along = half * first + drift
        self.size, self.whole = at.size, at.size + along

    @cached_property
    def wide(self) -> tuple[Floats, Floats]:
        """|q̇| of the arm and where the model is evaluated [N n]."""
        return self.speed + self.tube.speed, self.speed + self.tube.model_speed

    @cached_property
    def moved(self) -> Floats:
        """Norm of the change of Ẏ by the position's tube [N]."""
        return self.sums(self.tube.position, self.speed)

    @cached_property
    def slopes(self) -> tuple[Floats, Floats]:
        """Norms of Ẏ_v for the tubes of the arm's velocities and the model's [N]."""
        tube = self.tube
        return self.slope(tube.speed, tube.speed_norm), self.slope(tube.model_speed, tube.model_norm)

    @cached_property
    def bend_rate(self) -> Floats:
        """Norm of the rate of `X⃛` without its share of the jerk [N]."""
        speed, acceleration, vectors = self.speed, self.acceleration, self.vectors
        return (
            vectors(speed, speed, speed, speed)
            + 6.0 * vectors(speed, speed, acceleration)
            + 3.0 * vectors(acceleration, acceleration)
            + 4.0 * vectors(speed, self.path.cells.jerk)
        )

    @cached_property
    def bend(self) -> Floats:
        """Norm of `X⃛` without its share of the jerk, on the motion [N]."""
        return np.linalg.norm(self.at.bend, axis=1) + self.half * self.bend_rate + 3.0 * self.first * self.jump

    @cached_property
    def jerked(self) -> Floats:
        """Norm of X⃛ on the motion [N]."""
        return self.bend + self.reach * self.jerk

    @cached_property
    def force(self) -> Floats:
        """Norm of `Ẍ - g` on the motion [N]."""
        return np.linalg.norm(self.at.force, axis=1) + self.half * self.jerked + self.reach * self.jump

    @cached_property
    def forces(self) -> tuple[Floats, Floats]:
        """Norms of its changes by the tubes of the arm and of the model [N]."""
        tube, place = self.tube, self.tube.position
        results = []
        for wide, slope, norm in zip(self.wide, self.slopes, (tube.speed_norm, tube.model_norm), strict=True):
            bent = self.vectors(place, wide, wide) + self.vectors(place, self.acceleration)
            results.append(bent + (2.0 * self.first + 2.0 * self.moved + slope) * norm * self.grown)
        return results[0], results[1]

    @cached_property
    def turned(self) -> Floats:
        """Norms of the changes of `∂_j Y` over cell and tube [N n]."""
        gone = self.half * self.speed + self.tube.position
        return self.sums_each(gone)

    @cached_property
    def coriolis_moved(self) -> Floats:
        """Norm of the change of `2 YᵀẎ` over the cell, on the motion [N]."""
        half, whole = self.half, self.whole
        return half * (
            self.at.coriolis_rate
            + half * (3.0 * self.first * self.second + self.third * whole)
            + 2.0 * whole * self.sums(self.path.cells.jump)
        )

    def coriolis_change(self, speed: Floats, norm: Floats) -> Floats:
        """Norm of the change of `2 YᵀẎ` over cell and tube, for velocities of the tube of these sizes and norm [N]."""
        moved = self.drift * self.first + self.whole * self.moved + self.turn(speed, norm)
        return self.coriolis_moved + 2.0 * moved

    def stiffness_change(self, model: bool) -> Floats:
        """Norms of the changes of the columns of P over cell and tube, without s [N n].

        - `model`: True for the tube of where the model is evaluated; False for that of the arm.
        """
        half, cells, vectors = self.half, self.path.cells, self.vectors_each
        wide, force = self.wide[int(model)], self.forces[int(model)]
        norm = self.tube.model_norm if model else self.tube.speed_norm
        gone = half * self.speed + self.tube.position
        bent = vectors(wide, wide) + vectors(self.acceleration)
        bent_more = (
            vectors(gone, wide, wide)
            + vectors(gone, self.acceleration)
            + vectors(half * cells.jerk + cells.jump)
            + 2.0 * vectors(half * self.acceleration, wide)
            + 2.0 * self.sums_each(wide) * (norm * self.grown)[:, None]
        )
        return (
            self.turned * (self.force + force)[:, None]
            + self.outer * (half * self.jerked + self.reach * self.jump + force)[:, None]
            + self.along[:, None] * bent
            + self.size[:, None] * bent_more
        )

    def slope(self, speed: Floats, norm: Floats) -> Floats:
        """Norm of Ẏ_v for velocities v of these sizes and this norm [N]."""
        return self.least(self.at.slopes, self.at.slopes_norm, speed, norm) + self.crossed(speed)

    def turn(self, speed: Floats, norm: Floats) -> Floats:
        """Norm of `Yᵀ Ẏ_v` [N]."""
        least = self.least(self.at.turning, self.at.turning_norm, speed, norm)
        return least + self.along * self.sums(speed) + self.whole * self.crossed(speed)

    def least(self, by_joint: Floats, by_norm: Floats, speed: Floats, norm: Floats) -> Floats:
        """The smaller of two bounds of a sum over the joints, for velocities of these sizes and this norm [N]."""
        return np.minimum(np.sum(speed * by_joint, axis=1), norm * by_norm * self.grown)

    def crossed(self, speed: Floats) -> Floats:
        """Norm of the change of Ẏ_v over cell and tube [N]."""
        return self.half * self.sums(self.speed, speed) + self.sums(self.tube.position, speed)

    def sums(self, *each: Floats) -> Floats:
        """`Σ B_max(i, …, k) a_i … b_k` [N], a bound of `‖Σ a_i … b_k ∂_i … ∂_k Y x‖` for ‖x‖ = 1."""
        return _sums(self.outer, each)

    def vectors(self, *each: Floats) -> Floats:
        """`Σ ‖∂_max(i, …, k) X‖ a_i … b_k` [N], a bound of `‖Σ a_i … b_k ∂_i … ∂_k X‖`."""
        return _sums(self.own, each)

    def sums_each(self, *each: Floats) -> Floats:
        """`sums` of a unit vector and these, for the unit vector of each joint [N n]."""
        return _sums_each(self.outer, each)

    def vectors_each(self, *each: Floats) -> Floats:
        """`vectors` of a unit vector and these, for the unit vector of each joint [N n]."""
        return _sums_each(self.own, each)


class Cell(PointCell):
    """The nominal arm over the cells and the tube.

    - `shift`: change of M0 relative to the centre's; `rest`: its share but for Ṁ0 at the centre.
    - `inflated`: factor of a bilinear form from the metric of the centre to the actual one.
    - `diagonal`, `weight`: √(M0)_ii at the centre, and its largest value [N n]; `inertia`: |M0| by element [N n n].
    - `cover`: the points of the region's cover.
    """

    def __init__(self, path: Path, tube: Tube) -> None:
        super().__init__(path, path.norms, tube)
        place, half, first, sums, whole = tube.position, self.half, self.first, self.sums, self.whole
        by_tube = (
            2.0 * np.sum(place * self.at.turning, axis=1)
            + 2.0 * half * (sums(place, self.speed) * whole + first * self.drift)
            + sums(place, place) * whole
            + self.drift**2
        )
        self.rest = half**2 * (first**2 + self.second * whole) + by_tube
        self.shift = half * path.change + self.rest
        # `suprema` refuses a larger change.
        self.inflated = 1.0 / (1.0 - np.minimum(self.shift, 0.5))
        self.diagonal = np.sqrt(np.diagonal(path.mass, axis1=1, axis2=2))
        self.inertia = np.abs(path.mass) + half * np.abs(path.rate)
        self.inertia += self.rest[:, None, None] * self.diagonal[:, :, None] * self.diagonal[:, None]
        self.weight = np.sqrt(np.diagonal(self.inertia, axis1=1, axis2=2))
        self.reach = np.ones_like(self.shift)
        self.cover = PointCell(path, path.cover_norms, tube)
        self.cover.reach = self.cover.whole
        for points in (self, self.cover):
            points.grown = np.sqrt(self.inflated)
            points.jump = size_in(path.cells.jump, self.inertia)
            points.jerk = size_in(path.cells.jerk, self.inertia)

    def torques(self, rows: Floats, shift: Floats) -> Floats:
        """Largest `|A x|_i` over all x of norm 1 [N n].

        - `rows`: that of the centres [N n], with what is known there of its change.
        - `shift`: norm of A's further change [N].
        """
        return np.asarray((rows + self.diagonal * shift[:, None]) * self.grown[:, None])

    @cached_property
    def coriolis_shift(self) -> Floats:
        """Norm of the change of `2 C(q, v)` over cell and tube, for the mean v of the arm's and the model's [N]."""
        tube = self.tube
        return self.coriolis_change(0.5 * (tube.speed + tube.model_speed), 0.5 * (tube.speed_norm + tube.model_norm))

    @cached_property
    def stiffness_shift(self) -> Floats:
        """Norms of the changes of the columns of P over cell and tube, without s [N n]."""
        return self.stiffness_change(True)


def _outer(bodies: BodyPoints, at: PointNorms, conversion: Floats, box: Floats) -> tuple[Floats, Floats]:
    """B_k and ‖∂_k X‖ for all positions within a box around the centre [N n].

    With `x = Σ x_l e_l` and k the outermost joint of a derivative, ‖∂_i … ∂_k Y x‖ is at most the size of the columns
    from k on and ‖∂_k X‖ times the sum of all |x_l| before. Joints before k move the points that k moves as a rigid
    body; only those behind k change the two norms.
    """
    outer, own = at.outer.copy(), at.own.copy()
    n = own.shape[1]
    for k in reversed(range(n)):
        behind = [j for j in range(k + 1, n) if bodies.before[k, j]]
        ahead = [j for j in range(k) if bodies.before[j, k]]
        own[:, k] += np.sum(box[:, behind] * own[:, behind], axis=1)
        outer[:, k] += np.sum(box[:, behind] * outer[:, behind], axis=1)
        outer[:, k] += own[:, k] * np.sum(conversion[:, ahead], axis=1)
    return outer, own


def _sums(weights: Floats, each: tuple[Floats, ...]) -> Floats:
    product = _up_to(each)
    return np.asarray(np.sum(weights * np.diff(product, axis=1, prepend=0.0), axis=1))


def _sums_each(weights: Floats, each: tuple[Floats, ...]) -> Floats:
    # With a unit vector of joint j, the products begin at j.
    product = _up_to(each)
    steps = weights * np.diff(product, axis=1, prepend=0.0)
    return np.asarray(np.cumsum(steps[:, ::-1], axis=1)[:, ::-1] - steps + weights * product)


def _up_to(each: tuple[Floats, ...]) -> Floats:
    """The product of sums over all joints up to each one."""
    product = np.cumsum(each[0], axis=1)
    for values in each[1:]:
        product = product * np.cumsum(values, axis=1)
    return np.asarray(product)
