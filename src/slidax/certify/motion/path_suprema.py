"""Suprema along a motion, for every instant of its cells and every arm position within a tube around it.

All norms are taken in the metric of M0 at the actual position, `‖x‖² = xᵀ M0(q) x`. No quantity is sampled:
path_tube.py bounds its change over a cell and the tube.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slidax.core.errors import DefinitionError

from .path_norms import Path, size_in, spectral_norm
from .path_tube import Cell, Tube

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class BodyBand:
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
                raise DefinitionError(f"`BodyBand.{name}` must be in [0, 1); got {value:g}")

    @property
    def largest(self) -> float:
        return max(self.bodies, self.rotors)


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


def suprema(path: Path, band: BodyBand, tube: Tube) -> Suprema | None:
    """Return the suprema; None if the inertia changes too much within a cell and its tube."""
    cell = Cell(path, tube)
    return _suprema(cell, band) if np.all(cell.shift < 0.5) else None


def _suprema(cell: Cell, band: BodyBand) -> Suprema:
    path, tube, at = cell.path, cell.tube, cell.at
    cells, conversion = path.cells, cell.conversion
    h, half, along, drift, shift = cells.period, cell.half, cell.along, cell.drift, cell.shift
    speed, acceleration = cell.speed, cell.acceleration
    first, second, place, moved = cell.first, cell.second, tube.position, cell.moved
    sums, vectors = cell.sums, cell.vectors
    inflated, grown = cell.inflated, cell.grown
    spread = shift * inflated
    conversion_sup = conversion * grown[:, None]
    diagonal, inertia = cell.diagonal, cell.inertia
    inverse = np.abs(path.inverse) + spread[:, None, None] * conversion[:, :, None] * conversion[:, None]

    # Ṁ and the rate of E along the arm's own motion.
    both = tube.speed, tube.speed_norm
    turn = cell.turn(*both)
    motion_change = at.change + 2.0 * half * (first**2 + second * (1.0 + along))
    change = (motion_change + 2.0 * (drift * first + (1.0 + along) * moved + turn)) * inflated
    # The common rotation that is taken from Ẏ changes as well.
    total, total_rate = np.sum(speed, axis=1), np.sum(acceleration + cells.jump, axis=1)
    turned_rate = second + (total_rate + total**2) * (1.0 + along) + total * first
    slide = change + 2.0 * (at.relative + half * turned_rate + cell.relative(speed, *both)) * inflated

    # 2 C(q, q̇), and the derivative of the inverse dynamics by q.
    coriolis_shift, stiff_shift = cell.coriolis_shift, cell.stiffness_shift
    coriolis = (at.coriolis + coriolis_shift) * inflated
    departs = (coriolis_shift + spread * (at.coriolis + coriolis_shift))[:, None]
    rows = np.linalg.norm(path.inverse @ at.coriolis_matrix @ path.root, axis=2)
    coriolis_rows = (rows + conversion * departs) * np.sqrt(inflated)[:, None]
    coriolis_entries = np.abs(path.inverse @ at.coriolis_matrix) + (
        conversion[:, :, None] * departs[:, :, None] * diagonal[:, None]
    )

    stiff = spectral_norm(path.root.swapaxes(1, 2) @ at.stiffness_matrix @ path.root)
    stiff_sum = stiff + np.sum(stiff_shift * conversion, axis=1)
    stiffness = stiff_sum * inflated
    stiffness_entries = (
        np.abs(path.inverse @ at.stiffness_matrix)
        + conversion[:, :, None]
        * ((1.0 + spread)[:, None] * stiff_shift + (spread * stiff)[:, None] * diagonal)[:, None]
    )
    per_command = 2.0 * (at.turning + (1.0 + along)[:, None] * cell.turned + along[:, None] * cell.outer)

    # The band.
    shares, band_force, rate_force = band_forces(cell, band)
    rotors = np.sqrt(path.bodies.rotors)
    force_tube = cell.forces[0]
    lever = np.concatenate([at.lever, rotors * np.abs(path.inverse)], axis=2)
    band_rate = ((first + motion_change) * band_force + rate_force) * inflated
    band_joints = np.einsum("nib,nb->ni", lever, shares) + conversion_sup * (half * band_rate)[:, None]
    band_joints = band_joints + conversion_sup * (band.largest * cell.jump * inflated)[:, None]
    band_tube = (band.largest * force_tube + (drift + 2.0 * drift * (1.0 + drift)) * band_force) * inflated

    # Travel within a period, for the acceleration that the model is given: odd and even about the middle.
    fed = (size_in(acceleration, inertia) + tube.command_norm) * grown
    whole = acceleration + tube.command
    fastest = speed + np.maximum(tube.speed, tube.model_speed)
    travelled = size_in(cell.wide[0], inertia) * grown
    pulled = cell.force + cell.forces[1] + fed
    faster = first + moved + np.maximum(*cell.slopes)
    second_tube = second + sums(place, fastest, fastest) + sums(place, whole) + sums(tube.command)
    second_tube = second_tube + 2.0 * sums(fastest, fastest - speed)
    bending = vectors(fastest, fastest, fastest) + vectors(fastest, whole)
    second_rate = 2.0 * (faster**2 + (1.0 + along) * second_tube)
    stiff_rate = second_tube * pulled + 2.0 * faster * (bending + 2.0 * faster * fed)
    stiff_rate = stiff_rate + vectors(fastest, fastest, fastest, fastest) + 3.0 * vectors(fastest, fastest, whole)
    stiff_rate = stiff_rate + vectors(whole, whole)
    whole_stiffness = (stiff_sum + np.sum(per_command * conversion, axis=1) * tube.command_norm * grown) * inflated
    odd = whole_stiffness * travelled + coriolis * fed
    varied = cell.turn(h * tube.acceleration, h * tube.acceleration_norm) * fed * h * inflated
    held = 0.25 * h * h * (second_rate * fed + (1.0 + along) * stiff_rate + change * odd) * inflated + varied
    held = held + 0.375 * h * h * whole_stiffness * fed
    missed = h * h / 8.0 * cell.jerk + 0.25 * h * cell.jump
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


def band_forces(cell: Cell, band: BodyBand) -> tuple[Floats, Floats, Floats]:
    """Return p times the size of `Ẍ - g`: per body at the centres, of all in the cells, and of its rate."""
    cells, at = cell.path.cells, cell.at
    rotors = np.sqrt(cell.path.bodies.rotors)
    shares = np.concatenate([band.bodies * at.force, band.rotors * rotors * np.abs(cells.ddq)], axis=1)
    moving = np.concatenate([band.bodies * (at.bend + cell.bend[:, None]), band.rotors * rotors * cells.jerk], axis=1)
    rate = np.linalg.norm(moving, axis=1) + band.largest * cell.jerk
    return shares, np.linalg.norm(shares, axis=1) + cell.half * rate + band.largest * cell.jump, rate
