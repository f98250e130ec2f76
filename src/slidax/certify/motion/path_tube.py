"""Bounds of the arm's inertia, Coriolis matrix and their derivatives over the cells of a motion and a tube around it.

The motion is cut into short time cells, and the tube has the largest deviations of the arm from it. X(q) has the
positions of body points, and `Y = ∂X/∂q` is their Jacobian (body_points.py). Each quantity is exact at the centre of a
cell. Its change over the cell and the tube is bounded by Taylor's theorem. The first terms have the derivatives of Y
along the motion, exact at the centre. The remainder is bounded by `‖∂_i … ∂_k Y x‖ <= B_k ‖x‖`, with k the outermost
joint of the derivative and a factor B_k for each joint (`_outer`).
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
    """Largest deviations from the motion in each cell: of the arm, and of the state at which the model is evaluated.

    Vectors are [cells n]. Norms are in the metric of the nominal inertia matrix M0 [cells].

    - `position`: |q - q_d|, the larger of the arm's and the model state's.
    - `speed`, `speed_norm`: |q̇ - q̇_d| of the arm, and its norm.
    - `model_speed`, `model_norm`: |q̇ - q̇_d| of the model's state, and its norm.
    - `command`, `command_norm`: |s| of the law's feedback acceleration s, and its norm.
    - `acceleration`, `acceleration_norm`: |ë - s| of the arm, and its norm.
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
        """Return the tube of width 0, which is the motion itself."""
        nothing = np.zeros_like(cells.speed)
        return cls(
            nothing, nothing, nothing[:, 0], nothing, nothing[:, 0], nothing, nothing[:, 0], nothing, nothing[:, 0]
        )


class PointCell:
    """Bounds of derivatives of points X over each cell and the tube around it.

    `Y = ∂X/∂q` is the Jacobian of the points. Norms are in the metric of M0 at the cell's centre, one value per cell.
    The model's state is the position and velocity at which the law evaluates its model. M0 is the nominal inertia.

    - `half`: half the length of a cell plus half a period, since the law evaluates its model up to half a period before
      or after the cell.
    - `size`, `whole`: norm of Y at the centre, and its bound over cell and tube.
    - `first`, `second`, `third`: bounds of the norms of Y's time derivatives over the cell, on the motion.
    - `drift`, `along`: bounds of the norm of the change of Y by the tube, and over cell and tube together.

    `Cell` sets these fields. The actual metric is that of M0 at the arm's position:

    - `grown`: bound of the ratio of a vector's norm at the centre to its norm in the actual metric, or the reverse.
    - `jump`, `jerk`, `reach`: bounds of the norms of the acceleration's jumps, of the jerk and of Y in the actual
      metric.
    """

    grown: Floats
    jump: Floats
    jerk: Floats
    reach: Floats

    def __init__(self, path: Path, at: PointNorms, tube: Tube) -> None:
        """Compute the norms.

        - `path`: the arm at the centres. `at`: norms of the points there. `tube`: deviations from the motion.
        """
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
        """Bounds of |q̇| for the arm and for the model's state, each [cells n]."""
        return self.speed + self.tube.speed, self.speed + self.tube.model_speed

    @cached_property
    def moved(self) -> Floats:
        """Bound of the norm of the change of Ẏ by the position's deviation, at the motion's velocity [cells]."""
        return self.sums(self.tube.position, self.speed)

    @cached_property
    def slopes(self) -> tuple[Floats, Floats]:
        """Bounds of ‖Σ_j v_j ∂_j Y‖ for velocity deviations v in the tube: of the arm, of the model's state [cells]."""
        tube = self.tube
        return self.slope(tube.speed, tube.speed_norm), self.slope(tube.model_speed, tube.model_norm)

    @cached_property
    def bend_rate(self) -> Floats:
        """Bound of the norm of the time derivative of `X⃛ - Y q⃛` on the motion [cells]."""
        speed, acceleration, vectors = self.speed, self.acceleration, self.vectors
        return (
            vectors(speed, speed, speed, speed)
            + 6.0 * vectors(speed, speed, acceleration)
            + 3.0 * vectors(acceleration, acceleration)
            + 4.0 * vectors(speed, self.path.cells.jerk)
        )

    @cached_property
    def bend(self) -> Floats:
        """Bound of the norm of `X⃛ - Y q⃛` on the motion [cells]."""
        return np.linalg.norm(self.at.bend, axis=1) + self.half * self.bend_rate + 3.0 * self.first * self.jump

    @cached_property
    def jerked(self) -> Floats:
        """Bound of the norm of X⃛ on the motion [cells]."""
        return self.bend + self.reach * self.jerk

    @cached_property
    def force(self) -> Floats:
        """Bound of the norm of `Ẍ - g` on the motion [cells]."""
        return np.linalg.norm(self.at.force, axis=1) + self.half * self.jerked + self.reach * self.jump

    @cached_property
    def forces(self) -> tuple[Floats, Floats]:
        """Bounds of the norm of the change of `Ẍ - g` by the tube, for the arm and the model's state, each [cells]."""
        tube, place = self.tube, self.tube.position
        results = []
        for wide, slope, norm in zip(self.wide, self.slopes, (tube.speed_norm, tube.model_norm), strict=True):
            bent = self.vectors(place, wide, wide) + self.vectors(place, self.acceleration)
            results.append(bent + (2.0 * self.first + 2.0 * self.moved + slope) * norm * self.grown)
        return results[0], results[1]

    @cached_property
    def turned(self) -> Floats:
        """Bounds of the norms of the changes of `∂_j Y` over cell and tube, for each joint j [cells n]."""
        gone = self.half * self.speed + self.tube.position
        return self.sums_each(gone)

    @cached_property
    def coriolis_moved(self) -> Floats:
        """Bound of the norm of the change of `2 YᵀẎ` over the cell, on the motion [cells]."""
        half, whole = self.half, self.whole
        return half * (
            self.at.coriolis_rate
            + half * (3.0 * self.first * self.second + self.third * whole)
            + 2.0 * whole * self.sums(self.path.cells.jump)
        )

    def coriolis_change(self, speed: Floats, norm: Floats) -> Floats:
        """Return a bound of the norm of `2 YᵀẎ`'s change over cell and tube [cells].

        - `speed`, `norm`: bounds of the velocity's deviation v from the motion: |v| [cells n], and ‖v‖ [cells].
        """
        moved = self.drift * self.first + self.whole * self.moved + self.turn(speed, norm)
        return self.coriolis_moved + 2.0 * moved

    def stiffness_change(self, model: bool) -> Floats:
        """Return bounds of the norms of the changes of P's columns over cell and tube [cells n].

        P is the derivative of the inverse dynamics by q. Its part due to the feedback acceleration s is left out.

        - `model`: True for the tube of the model's state; False for the arm's.
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
        """Return a bound of the norm of `Ẏ_v = Σ_j v_j ∂_j Y` [cells], for |v_j| <= `speed` and ‖v‖ <= `norm`."""
        return self.least(self.at.slopes, self.at.slopes_norm, speed, norm) + self.crossed(speed)

    def turn(self, speed: Floats, norm: Floats) -> Floats:
        """Return a bound of the norm of `Yᵀ Ẏ_v = Σ_j v_j Yᵀ ∂_j Y` [cells], for |v_j| <= `speed` and ‖v‖ <= `norm`."""
        least = self.least(self.at.turning, self.at.turning_norm, speed, norm)
        return least + self.along * self.sums(speed) + self.whole * self.crossed(speed)

    def least(self, by_joint: Floats, by_norm: Floats, speed: Floats, norm: Floats) -> Floats:
        """Return the smaller of two bounds of `‖Σ_j v_j A_j‖` [cells]: by each |v_j|, and by ‖v‖.

        - `by_joint`: bounds of ‖A_j‖ [cells n]. `by_norm`: bound of the sum over v of norm 1 [cells].
        - `speed`, `norm`: bounds of |v_j| [cells n] and ‖v‖ [cells].
        """
        return np.minimum(np.sum(speed * by_joint, axis=1), norm * by_norm * self.grown)

    def crossed(self, speed: Floats) -> Floats:
        """Return a bound of how much `Ẏ_v = Σ_j v_j ∂_j Y` differs from its value at the cell's centre [cells].

        It holds in the whole cell and the tube around it. Y is the points' Jacobian.

        - `speed`: bounds of |v_j| [cells n].
        """
        return self.half * self.sums(self.speed, speed) + self.sums(self.tube.position, speed)

    def sums(self, *each: Floats) -> Floats:
        """Return a bound of `‖Σ a_i … b_k ∂_i … ∂_k Y x‖` over all x of norm 1 [cells]: `Σ B_max(i, …, k) a_i … b_k`.

        - `each`: factors a, …, b, such as bounds of |q̇|, each [cells n]. B_k is `outer`.
        """
        return _sums(self.outer, each)

    def vectors(self, *each: Floats) -> Floats:
        """Return a bound of `‖Σ a_i … b_k ∂_i … ∂_k X‖` [cells]: `Σ ‖∂_max(i, …, k) X‖ a_i … b_k`.

        - `each`: factors a, …, b, such as bounds of |q̇|, each [cells n].
        """
        return _sums(self.own, each)

    def sums_each(self, *each: Floats) -> Floats:
        """Return for each joint the value of `sums` with the joint's unit vector as a further factor [cells n]."""
        return _sums_each(self.outer, each)

    def vectors_each(self, *each: Floats) -> Floats:
        """Return for each joint the value of `vectors` with the joint's unit vector as a further factor [cells n]."""
        return _sums_each(self.own, each)


class Cell(PointCell):
    """Bounds for the nominal arm over each cell and the tube.

    - `shift`: bound of M0's relative change from the centre, in norm [cells]; `rest`: its part of second order, and
      that by the tube [cells]. The other part is due to Ṁ0 at the centre.
    - `inflated`: bound of the ratio of a bilinear form's norm in the actual metric to its norm at the centre [cells].
    - `diagonal`, `weight`: √(M0)_ii at the centre, and its bound over cell and tube [cells n].
    - `inertia`: bound of |M0| by element over cell and tube [cells n n].
    - `cover`: bounds for the points of the region's cover.
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
        # For a larger change `suprema` returns None.
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
        """Return a bound of `|A x|_i` over all x of norm 1, for a matrix A that changes over cell and tube [cells n].

        - `rows`: the largest `|A x|_i` at the centres, plus A's change to first order [cells n].
        - `shift`: bound of the norm of A's further change [cells].
        """
        return np.asarray((rows + self.diagonal * shift[:, None]) * self.grown[:, None])

    @cached_property
    def coriolis_shift(self) -> Floats:
        """Bound of the norm of the change of `2 C(q, v)` over cell and tube [cells].

        v is the mean of two velocities: the arm's, and the velocity at which the model is evaluated.
        """
        tube = self.tube
        return self.coriolis_change(0.5 * (tube.speed + tube.model_speed), 0.5 * (tube.speed_norm + tube.model_norm))

    @cached_property
    def stiffness_shift(self) -> Floats:
        """`stiffness_change` for the model's state: bounds of the changes of the columns of P, in norm [cells n]."""
        return self.stiffness_change(True)


def _outer(bodies: BodyPoints, at: PointNorms, conversion: Floats, box: Floats) -> tuple[Floats, Floats]:
    """Return B_k and ‖∂_k X‖, each as a bound over all positions in a box around the centre [cells n].

    Let k be the outermost joint of a derivative. B_k bounds `‖∂_i … ∂_k Y x‖` for ‖x‖ = 1 by two parts: the columns of
    k and the joints that it carries, and ‖∂_k X‖ times the sum of |x_l| over the joints that carry k. A joint that
    carries k moves the points of k as a rigid body. So only joints that k carries change the two norms.

    - `box`: half widths of the box [cells n]. `conversion`: largest coordinates of a vector of norm 1 [cells n].
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
    # With the unit vector of joint j as a factor, the products are 0 before j.
    product = _up_to(each)
    steps = weights * np.diff(product, axis=1, prepend=0.0)
    return np.asarray(np.cumsum(steps[:, ::-1], axis=1)[:, ::-1] - steps + weights * product)


def _up_to(each: tuple[Floats, ...]) -> Floats:
    """Return, for each joint, the product of the factors' sums over all joints up to that joint."""
    product = np.cumsum(each[0], axis=1)
    for values in each[1:]:
        product = product * np.cumsum(values, axis=1)
    return np.asarray(product)
