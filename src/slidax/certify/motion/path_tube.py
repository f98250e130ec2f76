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
from .path_cells import PathCells
from .path_norms import Norms, Path, size_in

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Tube:
    """Deviation of the arm and of the model's arguments from the motion in each cell; vectors [N n], norms [N].

    - `position`: of the arm and of where the model is evaluated, |q - q_d|.
    - `speed`: of the arm, |q̇ - q̇_d|; `model_speed`: of where the model is evaluated; `speed_norm`, `model_norm`: in
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


class Cell:
    """Y and its derivatives over the cells and the tube around them, as norms in the metric of the centres.

    - `half`: half the length of a cell and half a period, since the model is evaluated up to that far from an instant.
    - `first`, `second`, `third`: of the derivatives of Y by time, on the motion.
    - `drift`, `along`: change of Y by the tube, and altogether. `shift`: change of M0, and
      `tube_shift`: its share by the tube.
    """

    def __init__(self, path: Path, tube: Tube) -> None:
        """Compute the norms."""
        self.path, self.tube, self.at = path, tube, path.norms
        at, cells = self.at, path.cells
        self.half = half = cells.half + 0.5 * cells.period
        self.conversion = np.sqrt(np.diagonal(path.inverse, axis1=1, axis2=2))
        self.speed, self.acceleration = speed, acceleration = cells.speed, cells.acceleration
        place = tube.position
        self.outer, self.own = _outer(path.bodies, at, self.conversion, half * speed + place)
        sums = self.sums
        self.third = third = sums(speed, speed, speed) + 3.0 * sums(speed, acceleration) + sums(cells.jerk)
        jumps = sums(cells.jump)
        self.second = second = at.second + half * third + jumps
        self.first = first = at.first + half * (at.second + jumps) + 0.5 * half**2 * third
        self.drift = drift = sums(place)
        self.along = along = half * first + drift
        self.tube_shift = (
            2.0 * np.sum(place * at.turning, axis=1)
            + 2.0 * half * (sums(place, speed) * (1.0 + along) + first * drift)
            + sums(place, place) * (1.0 + along)
            + drift**2
        )
        self.shift = half * at.change + half**2 * (first**2 + second * (1.0 + along)) + self.tube_shift

    @cached_property
    def inflated(self) -> Floats:
        """Factor of a bilinear form from the metric of the centre to the actual one [N]."""
        return np.asarray(1.0 / (1.0 - self.shift))

    @cached_property
    def grown(self) -> Floats:
        """Factor of a vector's norm to the metric of the centre [N]."""
        return np.sqrt(self.inflated)

    @cached_property
    def diagonal(self) -> Floats:
        """√(M0)_ii at the centre [N n]."""
        return np.sqrt(np.diagonal(self.path.mass, axis1=1, axis2=2))

    @cached_property
    def inertia(self) -> Floats:
        """|M0| by element [N n n]."""
        return np.abs(self.path.mass) + self.shift[:, None, None] * self.diagonal[:, :, None] * self.diagonal[:, None]

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
    def jump(self) -> Floats:
        """Norm of the acceleration's jumps [N]."""
        return size_in(self.path.cells.jump, self.inertia)

    @cached_property
    def jerk(self) -> Floats:
        """Norm of the jerk [N]."""
        return size_in(self.path.cells.jerk, self.inertia)

    @cached_property
    def bend(self) -> Floats:
        """Change of `X⃛` without its share of the jerk over half a cell [N]."""
        speed, acceleration, vectors = self.speed, self.acceleration, self.vectors
        quartic = (
            vectors(speed, speed, speed, speed)
            + 6.0 * vectors(speed, speed, acceleration)
            + 3.0 * vectors(acceleration, acceleration)
            + 4.0 * vectors(speed, self.path.cells.jerk)
        )
        return self.half * quartic + 3.0 * self.first * self.jump

    @cached_property
    def jerked(self) -> Floats:
        """Norm of X⃛ on the motion [N]."""
        return np.sqrt(np.sum(self.at.bend**2, axis=1)) + self.bend + self.jerk

    @cached_property
    def force(self) -> Floats:
        """Norm of `Ẍ - g` on the motion [N]."""
        return np.sqrt(np.sum(self.at.force**2, axis=1)) + self.half * self.jerked + self.jump

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
    def units(self) -> list[Floats]:
        """The unit vectors, for each cell."""
        return [np.broadcast_to(row, self.speed.shape) for row in np.eye(self.speed.shape[1])]

    @cached_property
    def turned(self) -> Floats:
        """Norms of the changes of `∂_j Y` over cell and tube [N n]."""
        gone = self.half * self.speed + self.tube.position
        return np.stack([self.sums(unit, gone) for unit in self.units], axis=1)

    @cached_property
    def bent(self) -> Floats:
        """Norms of the derivatives of Ẍ by q where the model is evaluated, without s [N n]."""
        wide = self.wide[1]
        return np.stack(
            [self.vectors(unit, wide, wide) + self.vectors(unit, self.acceleration) for unit in self.units], axis=1
        )

    @cached_property
    def coriolis_shift(self) -> Floats:
        """Norm of the change of `2 C(q, v)` over cell and tube, for the mean v of the arm's and the model's [N]."""
        at, half, along, tube = self.at, self.half, self.along, self.tube
        turn = self.turn(0.5 * (tube.speed + tube.model_speed), 0.5 * (tube.speed_norm + tube.model_norm))
        return (
            half * at.coriolis_rate
            + half**2 * (3.0 * self.first * self.second + self.third * (1.0 + along))
            + 2.0 * (self.drift * self.first + (1.0 + along) * self.moved + turn)
            + 2.0 * half * (1.0 + along) * self.sums(self.path.cells.jump)
        )

    @cached_property
    def stiffness_shift(self) -> Floats:
        """Norms of the changes of the columns of P over cell and tube, without s [N n]."""
        half, wide, cells = self.half, self.wide[1], self.path.cells
        gone = half * self.speed + self.tube.position
        vectors = self.vectors
        bent_more = np.stack(
            [
                vectors(unit, gone, wide, wide)
                + vectors(unit, gone, self.acceleration)
                + vectors(unit, half * cells.jerk + cells.jump)
                + 2.0 * vectors(unit, half * self.acceleration, wide)
                + 2.0 * self.sums(unit, wide) * self.tube.model_norm * self.grown
                for unit in self.units
            ],
            axis=1,
        )
        model = self.forces[1]
        return (
            self.turned * (self.force + model)[:, None]
            + self.outer * (half * self.jerked + self.jump + model)[:, None]
            + self.along[:, None] * self.bent
            + bent_more
        )

    def slope(self, speed: Floats, norm: Floats) -> Floats:
        """Norm of Ẏ_v for velocities v of these sizes and this norm [N]."""
        return self._least(self.at.slopes, self.at.slopes_norm, speed, norm) + self._crossed(speed)

    def turn(self, speed: Floats, norm: Floats) -> Floats:
        """Norm of `Yᵀ Ẏ_v`."""
        least = self._least(self.at.turning, self.at.turning_norm, speed, norm)
        return least + self.along * self.sums(speed) + (1.0 + self.along) * self._crossed(speed)

    def relative(self, motion: Floats, speed: Floats, norm: Floats) -> Floats:
        """Norm of Ẏ_v but for a common rotation, and its change by the tube for velocities `motion`."""
        least = self._least(self.at.relative_slopes, self.at.relative_norm, speed, norm) + self._crossed(speed)
        place = self.tube.position
        gone = np.sum(self.half * self.speed + place, axis=1) * (1.0 + self.along) + self.half * self.first + self.drift
        least = least + gone * np.sum(speed, axis=1) + self.sums(place, motion)
        return least + (np.sum(place, axis=1) * (1.0 + self.along) + self.drift) * np.sum(motion, axis=1)

    def _least(self, by_joint: Floats, by_norm: Floats, speed: Floats, norm: Floats) -> Floats:
        return np.minimum(np.sum(speed * by_joint, axis=1), norm * by_norm / np.sqrt(1.0 - np.minimum(self.shift, 0.5)))

    def _crossed(self, speed: Floats) -> Floats:
        return self.half * self.sums(self.speed, speed) + self.sums(self.tube.position, speed)

    def sums(self, *each: Floats) -> Floats:
        """`Σ B_max(i, …, k) a_i … b_k` [N], a bound of `‖Σ a_i … b_k ∂_i … ∂_k Y x‖` for ‖x‖ = 1."""
        return _sums(self.outer, each)

    def vectors(self, *each: Floats) -> Floats:
        """`Σ ‖∂_max(i, …, k) X‖ a_i … b_k` [N], a bound of `‖Σ a_i … b_k ∂_i … ∂_k X‖`."""
        return _sums(self.own, each)


def _outer(bodies: BodyPoints, at: Norms, conversion: Floats, box: Floats) -> tuple[Floats, Floats]:
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
    product = np.ones_like(each[0])
    for values in each:
        product = product * np.cumsum(values, axis=1)
    return np.asarray(np.sum(weights * np.diff(product, axis=1, prepend=0.0), axis=1))
