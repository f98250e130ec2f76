"""Suprema along a motion, for every instant of its cells and every arm position within a tube around it.

All norms are taken in the metric of M0 at the actual position, `‖x‖² = xᵀ M0(q) x`. Each quantity is computed at the
centre of a cell; its change over the cell and the tube is bounded by Taylor's theorem with the derivatives of Y along
the motion, which are exact at the centre, and by `‖∂_i … ∂_k Y x‖ <= B_k ‖x‖` for the rest, with k the outermost joint
of the derivative (body_points.py). No quantity is sampled. Inside a cell the metric is that of its centre.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from slidax.core.errors import DefinitionError

from .body_points import Bodies, PointMotion, point_motion
from .path_cells import PathCells

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Band:
    """Band of inertial parameters around the nominal arm.

    - `bodies`: p with `(1 - p) J0 <= J <= (1 + p) J0` for the pseudo-inertia of every link and the payload.
    - `rotors`: the same for the inertia of the rotors.

    Raises DefinitionError unless both are in [0, 1).
    """

    bodies: float
    rotors: float

    def __post_init__(self) -> None:
        for name in ("bodies", "rotors"):
            value = getattr(self, name)
            if not 0.0 <= value < 1.0:
                raise DefinitionError(f"`Band.{name}` must be in [0, 1); got {value:g}")

    @property
    def largest(self) -> float:
        return max(self.bodies, self.rotors)


@dataclass(frozen=True, eq=False)
class Tube:
    """Deviation of the arm and of the model's arguments from the motion in each cell; vectors [N n], norms [N].

    - `position`: of the arm and of where the model is evaluated, |q - q_d|.
    - `speed`: of the arm, |q̇ - q̇_d|; `model_speed`: of where the model is evaluated; `speed_norm`, `model_norm`: in
      the metric.
    - `command`: |s|; `command_norm`: in the metric.
    """

    position: Floats
    speed: Floats
    speed_norm: Floats
    model_speed: Floats
    model_norm: Floats
    command: Floats
    command_norm: Floats

    @classmethod
    def none(cls, cells: PathCells) -> Tube:
        """Return the tube of no width."""
        nothing = np.zeros_like(cells.speed)
        return cls(nothing, nothing, nothing[:, 0], nothing, nothing[:, 0], nothing, nothing[:, 0])


@dataclass(frozen=True, eq=False)
class Suprema:
    """Bounds in each of N cells; vectors are per joint.

    - `conversion`: `√(M0⁻¹)_ii`: size of a joint's coordinate for a vector of norm 1 [N n].
    - `inverse`, `inertia`: |M0⁻¹| and |M0| by element [N n n].
    - `growth`: rate at which the norm of a constant vector grows [N], 1/s; `slide`: rate of `M0⁻¹ E` per p [N], 1/s.
    - `coriolis`: norm of `2 C(q, q̇)` [N]; `coriolis_rows`: norms of the rows of `M0⁻¹ 2 C` [N n];
      `coriolis_entries`: `|M0⁻¹ 2 C|` by element [N n n].
    - `stiffness`, `stiffness_entries`: the same for the derivative of the inverse dynamics by q.
    - `per_command`: norm of its share of the command s, per joint and norm of s [N n].
    - `band`: norm of `M0⁻¹ (E q̈_d + Δn)` along the motion [N]; `band_joints`: per joint [N n]; `band_rate`: norm of its
      rate, but for jumps of the acceleration [N]; `band_tube`: further norm by the tube, without ë [N].
    - `held`: norm of the disturbance by travel within a period that is even about its middle [N]; `odd`: rate of the
      odd part [N]. `reference`: norm of the disturbance by the reference's own miss between samples [N].
    """

    conversion: Floats
    inverse: Floats
    inertia: Floats
    growth: Floats
    slide: Floats
    coriolis: Floats
    coriolis_rows: Floats
    coriolis_entries: Floats
    stiffness: Floats
    stiffness_entries: Floats
    per_command: Floats
    band: Floats
    band_joints: Floats
    band_rate: Floats
    band_tube: Floats
    held: Floats
    odd: Floats
    reference: Floats


@dataclass(frozen=True, eq=False)
class Path:
    """The nominal arm along a motion: everything that does not depend on the tube."""

    bodies: Bodies
    cells: PathCells
    points: PointMotion = field(repr=False)

    @classmethod
    def of(cls, bodies: Bodies, cells: PathCells) -> Path:
        """Return the arm at the centres of the cells."""
        return cls(bodies, cells, point_motion(bodies, cells.q, cells.dq, cells.ddq, cells.dddq))

    @cached_property
    def mass(self) -> Floats:
        """M0 at the centres [N n n]."""
        y = self.points.columns[0]
        return _gram(y, y) + np.diag(self.bodies.rotors)

    @cached_property
    def root(self) -> Floats:
        """`G⁻ᵀ` with `M0 = G Gᵀ` [N n n]: its columns are orthonormal in the metric."""
        return np.asarray(np.linalg.inv(np.linalg.cholesky(self.mass)).swapaxes(1, 2))

    @cached_property
    def inverse(self) -> Floats:
        """M0⁻¹ at the centres [N n n]."""
        return np.asarray(self.root @ self.root.swapaxes(1, 2))

    @cached_property
    def norms(self) -> Norms:
        """Norms at the centres."""
        return Norms.of(self)

    def suprema(self, band: Band, tube: Tube) -> Suprema | None:
        """Return the suprema; None if the inertia changes too much within a cell and its tube."""
        cell = Cell(self, tube)
        if not np.all(cell.shift < 0.5):
            return None
        return _suprema(cell, band)


@dataclass(frozen=True, eq=False)
class Norms:
    """Norms at the centres, in the metric there.

    - `first`, `second`: of Ẏ and Ÿ [N]; `relative`: of Ẏ but for a common rotation [N].
    - `change`, `coriolis`, `coriolis_rate`: of Ṁ, of `2 C` and of its rate [N].
    - `slopes`, `turning`, `relative_slopes`: of `∂_j Y`, of `Yᵀ ∂_j Y`, and of ∂_j Y but for a common rotation [N n];
      `slopes_norm`, `turning_norm`, `relative_norm`: of their sums over j, per norm of the velocities [N].
    - `outer`: ‖Y x‖ of joints from k on, for ‖x‖ = 1 [N n]; `own`: ‖∂_k X‖ [N n].
    - `force`, `bend`: of `Ẍ - g` per body, and of `X⃛` without its share of the jerk [N m].
    - `lever`: `‖Y_b M0⁻¹ e_i‖` for each joint and body [N n m].
    - `coriolis_matrix`, `stiffness_matrix`: `2 C` and the derivative P of the inverse dynamics by q [N n n].
    """

    first: Floats
    second: Floats
    relative: Floats
    change: Floats
    coriolis: Floats
    coriolis_rate: Floats
    slopes: Floats
    turning: Floats
    relative_slopes: Floats
    slopes_norm: Floats
    turning_norm: Floats
    relative_norm: Floats
    outer: Floats
    own: Floats
    force: Floats
    bend: Floats
    lever: Floats
    coriolis_matrix: Floats
    stiffness_matrix: Floats

    @classmethod
    def of(cls, path: Path) -> Norms:
        """Compute the norms at the centres of a path's cells."""
        bodies, points, root = path.bodies, path.points, path.root
        y, y1, y2 = points.columns
        count, n = path.cells.q.shape
        unit, unit1, unit2 = y @ root, y1 @ root, y2 @ root
        slopes = np.moveaxis(points.slopes, 3, 1) @ root[:, None]
        turning = unit.swapaxes(1, 2)[:, None] @ slopes
        # A common rotation of all bodies changes no inner product: take it where that leaves less.
        spun = np.cross(points.axes[:, :, None, None], unit.reshape(count, -1, 3, n).swapaxes(2, 3)[:, None])
        spun = spun.swapaxes(3, 4).reshape(slopes.shape)
        whole, rest = _sizes(slopes), _sizes(slopes - spun)
        turns = rest < whole
        relative_slopes = np.where(turns[..., None, None], slopes - spun, slopes)
        relative = np.einsum("njdl,nj->ndl", relative_slopes, path.cells.dq)
        stiffness = np.einsum("ndjk,nd->nkj", points.slopes, points.acceleration) + _gram(y, y2)
        behind = bodies.before[None, :, :, None] & bodies.before[None, :, None, :]
        parts = np.where(behind, _gram(y, y)[:, None], 0.0)
        shape = (count, len(bodies.carrier), 12)
        lever = (y @ path.inverse).swapaxes(1, 2).reshape(count, n, *shape[1:])
        jerked = points.jerk - np.einsum("ndk,nk->nd", y, path.cells.dddq)
        return cls(
            first=_norm(unit1),
            second=_norm(unit2),
            relative=_norm(relative),
            change=_norm(_gram(unit, unit1) + _gram(unit1, unit)),
            coriolis=2.0 * _norm(_gram(unit, unit1)),
            coriolis_rate=2.0 * _norm(_gram(unit1, unit1) + _gram(unit, unit2)),
            slopes=whole,
            turning=_sizes(turning),
            relative_slopes=np.minimum(whole, rest),
            slopes_norm=_joint_norm(slopes, root),
            turning_norm=_joint_norm(turning, root),
            relative_norm=_joint_norm(relative_slopes, root),
            outer=np.sqrt(np.maximum(np.einsum("nkij,nij->nk", parts, path.inverse), 0.0)),
            own=np.sqrt(np.einsum("ndk,ndk->nk", y, y)),
            force=np.linalg.norm(points.acceleration.reshape(shape), axis=2),
            bend=np.linalg.norm(jerked.reshape(shape), axis=2),
            lever=np.linalg.norm(lever, axis=3),
            coriolis_matrix=2.0 * _gram(y, y1),
            stiffness_matrix=stiffness,
        )


class Cell:
    """Y and its derivatives over the cells and the tube around them, as norms in the metric of the centres.

    - `half`: half the length of a cell and half a period, since the model is evaluated up to that far from an instant.
    - `first`, `second`, `third`: of the derivatives of Y by time, on the motion.
    - `drift`, `along`: change of Y by the tube, and altogether. `shift`: change of M0.
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
        self.shift = (
            half * at.change
            + half**2 * (first**2 + second * (1.0 + along))
            + 2.0 * np.sum(place * at.turning, axis=1)
            + 2.0 * half * (sums(place, speed) * (1.0 + along) + first * drift)
            + sums(place, place) * (1.0 + along)
            + drift**2
        )

    def slope(self, speed: Floats, norm: Floats) -> Floats:
        """Norm of Ẏ_v for velocities v of these sizes and this norm [N]."""
        return self._least(self.at.slopes, self.at.slopes_norm, speed, norm) + self._crossed(speed)

    def turn(self, speed: Floats, norm: Floats) -> Floats:
        """Norm of `Yᵀ Ẏ_v`."""
        least = self._least(self.at.turning, self.at.turning_norm, speed, norm)
        return least + self.along * self.sums(speed) + (1.0 + self.along) * self._crossed(speed)

    def relative(self, speed: Floats, norm: Floats) -> Floats:
        """Norm of Ẏ_v but for a common rotation."""
        return self._least(self.at.relative_slopes, self.at.relative_norm, speed, norm) + 2.0 * self._crossed(speed)

    def _least(self, by_joint: Floats, by_norm: Floats, speed: Floats, norm: Floats) -> Floats:
        return np.minimum(np.sum(speed * by_joint, axis=1), norm * np.sqrt(1.0 + self.shift) * by_norm)

    def _crossed(self, speed: Floats) -> Floats:
        return self.half * self.sums(self.speed, speed) + self.sums(self.tube.position, speed)

    def sums(self, *each: Floats) -> Floats:
        """`Σ B_max(i, …, k) a_i … b_k` [N], a bound of `‖Σ a_i … b_k ∂_i … ∂_k Y x‖` for ‖x‖ = 1."""
        return _sums(self.outer, each)

    def vectors(self, *each: Floats) -> Floats:
        """`Σ ‖∂_max(i, …, k) X‖ a_i … b_k` [N], a bound of `‖Σ a_i … b_k ∂_i … ∂_k X‖`."""
        return _sums(self.own, each)


def _suprema(cell: Cell, band: Band) -> Suprema:
    path, tube, at = cell.path, cell.tube, cell.at
    bodies, cells, conversion = path.bodies, path.cells, cell.conversion
    h, half, along, drift, shift = cells.period, cell.half, cell.along, cell.drift, cell.shift
    speed, acceleration = cell.speed, cell.acceleration
    wide, model_wide = speed + tube.speed, speed + tube.model_speed
    first, second, third, place = cell.first, cell.second, cell.third, tube.position
    sums, vectors = cell.sums, cell.vectors
    inflated = 1.0 / (1.0 - shift)
    spread = shift * inflated
    grown = np.sqrt(1.0 + shift)
    conversion_sup = conversion * np.sqrt(inflated)[:, None]
    diagonal = np.sqrt(np.diagonal(path.mass, axis1=1, axis2=2))
    inverse = np.abs(path.inverse) + spread[:, None, None] * conversion[:, :, None] * conversion[:, None]
    inertia = np.abs(path.mass) + shift[:, None, None] * diagonal[:, :, None] * diagonal[:, None]

    # Ṁ and the rate of E along the arm's own motion.
    moved = sums(place, speed)
    both = tube.speed, tube.speed_norm
    slope, turn = cell.slope(*both), cell.turn(*both)
    motion_change = at.change + 2.0 * half * (first**2 + second * (1.0 + along))
    change = (motion_change + 2.0 * (drift * first + (1.0 + along) * moved + turn)) * inflated
    slide = change + 2.0 * (at.relative + 2.0 * half * second + moved + cell.relative(*both)) * inflated

    # 2 C(q, q̇).
    # Its velocity is the mean of the arm's and the model's.
    mean_turn = cell.turn(0.5 * (tube.speed + tube.model_speed), 0.5 * (tube.speed_norm + tube.model_norm))
    coriolis_shift = (
        half * at.coriolis_rate
        + half**2 * (3.0 * first * second + third * (1.0 + along))
        + 2.0 * (drift * first + (1.0 + along) * moved + mean_turn)
        + 2.0 * half * (1.0 + along) * sums(cells.jump)
    )
    coriolis = (at.coriolis + coriolis_shift) * inflated
    departs = (coriolis_shift + spread * (at.coriolis + coriolis_shift))[:, None]
    rows = np.linalg.norm(path.inverse @ at.coriolis_matrix @ path.root, axis=2)
    coriolis_rows = (rows + conversion * departs) * np.sqrt(inflated)[:, None]
    coriolis_entries = np.abs(path.inverse @ at.coriolis_matrix) + (
        conversion[:, :, None] * departs[:, :, None] * diagonal[:, None]
    )

    # Ẍ - g and X⃛ on the motion; the force that the tube adds.
    jump = size_in(cells.jump, inertia)
    jerk = size_in(cells.jerk, inertia)
    quartic = (
        vectors(speed, speed, speed, speed)
        + 6.0 * vectors(speed, speed, acceleration)
        + 3.0 * vectors(acceleration, acceleration)
        + 4.0 * vectors(speed, cells.jerk)
    )
    jerked = np.sqrt(np.sum(at.bend**2, axis=1)) + half * quartic + 3.0 * first * jump + jerk
    force = np.sqrt(np.sum(at.force**2, axis=1)) + half * jerked + jump
    bent_tube = vectors(place, wide, wide) + vectors(place, acceleration)
    force_tube = bent_tube + (2.0 * first + 2.0 * moved + slope) * tube.speed_norm * grown
    model_slope = cell.slope(tube.model_speed, tube.model_norm)
    model_force = vectors(place, model_wide, model_wide) + vectors(place, acceleration)
    model_force = model_force + (2.0 * first + 2.0 * moved + model_slope) * tube.model_norm * grown

    # The derivative of the inverse dynamics by q.
    units = [np.broadcast_to(row, speed.shape) for row in np.eye(speed.shape[1])]
    gone = half * speed + place
    turned = np.stack([sums(unit, gone) for unit in units], axis=1)
    bent = np.stack([vectors(unit, model_wide, model_wide) + vectors(unit, acceleration) for unit in units], axis=1)
    bent_more = np.stack(
        [
            vectors(unit, gone, model_wide, model_wide)
            + vectors(unit, gone, acceleration)
            + vectors(unit, half * cells.jerk + cells.jump)
            + 2.0 * vectors(unit, half * acceleration, model_wide)
            + 2.0 * sums(unit, model_wide) * tube.model_norm * grown
            for unit in units
        ],
        axis=1,
    )
    stiff_shift = (
        turned * (force + model_force)[:, None]
        + cell.outer * (half * jerked + jump + model_force)[:, None]
        + along[:, None] * bent
        + bent_more
    )
    stiff = _norm(path.root.swapaxes(1, 2) @ at.stiffness_matrix @ path.root)
    stiff_sum = stiff + np.sqrt(np.sum((stiff_shift * conversion) ** 2, axis=1) * speed.shape[1])
    stiffness = stiff_sum * inflated
    stiffness_entries = (
        np.abs(path.inverse @ at.stiffness_matrix)
        + conversion[:, :, None]
        * ((1.0 + spread)[:, None] * stiff_shift + (spread * stiff)[:, None] * diagonal)[:, None]
    )
    per_command = 2.0 * (at.turning + (1.0 + along)[:, None] * turned + along[:, None] * cell.outer)

    # The band.
    rotors = np.sqrt(bodies.rotors)
    shares = np.concatenate([band.bodies * at.force, band.rotors * rotors * np.abs(cells.ddq)], axis=1)
    moving = np.concatenate(
        [band.bodies * (at.bend + (half * quartic + 3.0 * first * jump)[:, None]), band.rotors * rotors * cells.jerk],
        axis=1,
    )
    rate_force = np.linalg.norm(moving, axis=1) + band.largest * jerk
    band_force = np.linalg.norm(shares, axis=1) + half * rate_force + band.largest * jump
    lever = np.concatenate([at.lever, rotors * np.abs(path.inverse)], axis=2)
    band_rate = ((first + motion_change) * band_force + rate_force) * inflated
    band_joints = np.einsum("nib,nb->ni", lever, shares) + conversion_sup * (half * band_rate)[:, None]
    band_joints = band_joints + conversion_sup * (band.largest * jump * inflated)[:, None]
    band_tube = (band.largest * force_tube + (drift + 2.0 * drift * (1.0 + drift)) * band_force) * inflated

    # Travel within a period, for the acceleration that the model is given: odd and even about the middle.
    fed = (size_in(acceleration, inertia) + tube.command_norm) * grown
    whole = acceleration + tube.command
    fastest = speed + np.maximum(tube.speed, tube.model_speed)
    travelled = size_in(wide, inertia) * grown
    pulled = force + model_force + fed
    faster = first + moved + np.maximum(slope, model_slope)
    second_tube = second + sums(place, fastest, fastest) + sums(place, whole) + sums(tube.command)
    second_tube = second_tube + 2.0 * sums(fastest, fastest - speed)
    bending = vectors(fastest, fastest, fastest) + vectors(fastest, whole)
    second_rate = 2.0 * (faster**2 + (1.0 + along) * second_tube)
    stiff_rate = second_tube * pulled + 2.0 * faster * (bending + 2.0 * faster * fed)
    stiff_rate = stiff_rate + vectors(fastest, fastest, fastest, fastest) + 3.0 * vectors(fastest, fastest, whole)
    stiff_rate = stiff_rate + vectors(whole, whole)
    whole_stiffness = (stiff_sum + np.sum(per_command, axis=1) * tube.command_norm) * inflated
    odd = whole_stiffness * travelled + coriolis * fed
    held = 0.25 * h * h * (second_rate * fed + stiff_rate + change * odd) * inflated
    held = held + 0.375 * h * h * whole_stiffness * fed
    missed = h * h / 8.0 * jerk + 0.25 * h * jump
    return Suprema(
        conversion=conversion_sup,
        inverse=inverse,
        inertia=inertia,
        growth=0.5 * change,
        slide=slide,
        coriolis=coriolis,
        coriolis_rows=coriolis_rows,
        coriolis_entries=coriolis_entries,
        stiffness=stiffness,
        stiffness_entries=stiffness_entries,
        per_command=per_command * inflated[:, None],
        band=band_force * np.sqrt(inflated),
        band_joints=band_joints,
        band_rate=band_rate,
        band_tube=band_tube,
        held=held,
        odd=odd,
        reference=(coriolis + h * stiffness) * missed,
    )


def _outer(bodies: Bodies, at: Norms, conversion: Floats, box: Floats) -> tuple[Floats, Floats]:
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


def _gram(a: Floats, b: Floats) -> Floats:
    return np.asarray(a.swapaxes(1, 2) @ b)


def _norm(a: Floats) -> Floats:
    """Spectral norms [N]."""
    return np.sqrt(np.maximum(np.linalg.eigvalsh(_gram(a, a))[:, -1], 0.0))


def _sizes(a: Floats) -> Floats:
    """Frobenius norms of the last two axes."""
    return np.asarray(np.sqrt(np.sum(a * a, axis=(-2, -1))))


def _joint_norm(slopes: Floats, root: Floats) -> Floats:
    """Bound of `‖Σ_j v_j slopes_j‖` for all v of norm 1 [N]."""
    inverse = root @ root.swapaxes(1, 2)
    weighted = np.einsum("njdk,nji->nidk", slopes, inverse)
    square = np.einsum("njdk,njdl->nkl", weighted, slopes, optimize=True)
    return np.asarray(np.sqrt(np.maximum(np.linalg.eigvalsh(square)[:, -1], 0.0)))


def size_in(x: Floats, inertia: Floats) -> Floats:
    """Return `√(|x|ᵀ |M| |x|)` [N], the largest norm of a vector whose entries have these sizes."""
    return np.sqrt(np.einsum("ni,nij,nj->n", x, inertia, x))
