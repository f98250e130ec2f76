"""Suprema along a motion, for every instant of its time cells and every arm state within a tube around it.

The tube has the largest deviations from the motion (`Tube`). All norms are taken in the metric of the nominal inertia
M0 at the actual position, `‖x‖² = xᵀ M0(q) x`. Values between the centres of the cells are not sampled: path_tube.py
bounds the change of each quantity over a cell and the tube.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .path import Path
from .path_norms import size_in, spectral_norm
from .path_tube import Cell, Tube

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Suprema:
    """Bounds in each cell, for all times in it and all arm states in the tube. Norms are in the metric of M0.

    M0 and C are the nominal inertia and Coriolis matrix, `E = M - M0` and `Δn` the errors of the inertia matrix and of
    the Coriolis torque with gravity. s is the law's feedback acceleration. The band is the uncertainty of the inertial
    parameters.

    - `conversion`: `√(M0⁻¹)_ii`, the largest coordinate i of a vector of norm 1 [cells n].
    - `inverse`, `inertia`: |M0⁻¹| and |M0| by element [cells n n].
    - `growth`: relative rate at which the norm of a constant vector grows, since M0 changes [cells], 1/s.
    - `slide`: norm of the rate of `M0⁻¹ E` [cells], 1/s.
    - `coriolis`: norm of `M0⁻¹ 2 C(q, q̇)` [cells]; `coriolis_rows`: norms of its rows [cells n]; `coriolis_entries`:
      its size by element [cells n n].
    - `coriolis_torques`, `change_torques`, `band_torques`: largest `|A x|_i` over all x of norm 1, for A = 2 C, Ṁ0 and
      E [cells n].
    - `stiffness`, `stiffness_entries`: norm [cells] and size by element [cells n n] of `M0⁻¹ P`, with P the derivative
      of the inverse dynamics by q, without the share of s.
    - `per_command`: norm of column j of the share of s in P, for s of norm 1 [cells n].
    - `band`: norm of the band's disturbance `M0⁻¹ (E q̈_d + Δn)` along the motion [cells]; `band_joints`: its size per
      joint [cells n]; `band_rate`: norm of its rate, without jumps of the acceleration [cells].
    - `band_tube`: norm of the change of `M0⁻¹ (E q̈_d + Δn)` from the motion to the arm's state in the tube [cells].
    - `band_torque`: |E q̈_d + Δn| per joint along the motion [cells n]; `torque_rate`: its rate without jumps
      [cells n]; `torque_jump`: the sum of its jumps [cells n].
    - `band_error`, `band_relative`: |E| and |M0⁻¹ E| by element [cells n n].
    - `held`: norm of the disturbance that arises since the arm moves within a period while the model's state is fixed
      [cells]. A part that is odd in time about the period's middle is left out; `odd`: the rate of that part [cells].
    - `reference`: norm of the disturbance that arises since the law uses the reference's mean acceleration in each
      period [cells].
    """

    conversion: Floats
    inverse: Floats
    inertia: Floats
    growth: Floats
    slide: Floats
    coriolis: Floats
    coriolis_rows: Floats
    coriolis_entries: Floats
    coriolis_torques: Floats
    change_torques: Floats
    stiffness: Floats
    stiffness_entries: Floats
    per_command: Floats
    band: Floats
    band_joints: Floats
    band_rate: Floats
    band_tube: Floats
    band_torque: Floats
    torque_rate: Floats
    torque_jump: Floats
    band_error: Floats
    band_torques: Floats
    band_relative: Floats
    held: Floats
    odd: Floats
    reference: Floats


def suprema(path: Path, tube: Tube) -> Suprema | None:
    """Return the suprema; None if M0 may change by half of it or more within a cell and its tube."""
    cell = Cell(path, tube)
    return _suprema(cell) if np.all(cell.shift < 0.5) else None


def _suprema(cell: Cell) -> Suprema:
    path, tube, at = cell.path, cell.tube, cell.at
    cells, conversion = path.cells, cell.conversion
    h, along, shift = cells.period, cell.along, cell.shift
    speed, acceleration = cell.speed, cell.acceleration
    first, second, place, moved = cell.first, cell.second, tube.position, cell.moved
    sums, vectors = cell.sums, cell.vectors
    inflated, grown = cell.inflated, cell.grown
    spread = shift * inflated
    diagonal, inertia = cell.diagonal, cell.inertia
    inverse = np.abs(path.inverse) + cell.half * np.abs(path.inverse @ path.rate @ path.inverse)
    inverse += (cell.rest + shift * spread)[:, None, None] * conversion[:, :, None] * conversion[:, None]
    conversion_sup = np.sqrt(np.diagonal(inverse, axis1=1, axis2=2))

    # Ṁ0, the symmetric part of 2 C: along the planned motion, and along the arm's own motion.
    motion_change = path.change + cell.coriolis_moved
    change_shift = cell.coriolis_change(tube.speed, tube.speed_norm)
    change = (path.change + change_shift) * inflated

    # By row: the change to first order is exact at the centre. Only the rest is bounded by a norm.
    (turn, turn_rate, rate, rate_rate), known = path.torques, cell.half * at.coriolis_rate
    # 2 C(q, q̇), and the derivative of the inverse dynamics by q.
    coriolis_shift, stiff_shift = cell.coriolis_shift, cell.stiffness_shift
    coriolis = (at.coriolis + coriolis_shift) * inflated
    departs = (coriolis_shift + spread * (at.coriolis + coriolis_shift))[:, None]
    rows = np.linalg.norm(path.inverse @ path.coriolis @ path.root, axis=2)
    coriolis_rows = (rows + conversion * departs) * np.sqrt(inflated)[:, None]
    coriolis_entries = np.abs(path.inverse @ path.coriolis) + (
        conversion[:, :, None] * departs[:, :, None] * diagonal[:, None]
    )

    stiff = spectral_norm(path.root.swapaxes(1, 2) @ path.stiffness @ path.root)
    stiff_sum = stiff + np.sum(stiff_shift * conversion, axis=1)
    stiffness = stiff_sum * inflated
    stiffness_entries = (
        np.abs(path.inverse @ path.stiffness)
        + conversion[:, :, None]
        * ((1.0 + spread)[:, None] * stiff_shift + (spread * stiff)[:, None] * diagonal)[:, None]
    )
    per_command = 2.0 * (at.turning + cell.whole[:, None] * cell.turned + along[:, None] * cell.outer)

    # Disturbance by travel within a period: the parts that are odd and even about the middle of the period.
    fed = (size_in(acceleration, inertia) + tube.command_norm) * grown
    whole = acceleration + tube.command
    fastest = speed + np.maximum(tube.speed, tube.model_speed)
    travelled = size_in(cell.wide[0], inertia) * grown
    pulled = cell.force + cell.forces[1] + fed
    faster = first + moved + np.maximum(*cell.slopes)
    second_tube = second + sums(place, fastest, fastest) + sums(place, whole) + sums(tube.command)
    second_tube = second_tube + 2.0 * sums(fastest, fastest - speed)
    bending = vectors(fastest, fastest, fastest) + vectors(fastest, whole)
    second_rate = 2.0 * (faster**2 + cell.whole * second_tube)
    stiff_rate = second_tube * pulled + 2.0 * faster * (bending + 2.0 * faster * fed)
    stiff_rate = stiff_rate + vectors(fastest, fastest, fastest, fastest) + 3.0 * vectors(fastest, fastest, whole)
    stiff_rate = stiff_rate + vectors(whole, whole)
    whole_stiffness = (stiff_sum + np.sum(per_command * conversion, axis=1) * tube.command_norm * grown) * inflated
    odd = whole_stiffness * travelled + coriolis * fed
    varied = cell.turn(h * tube.acceleration, h * tube.acceleration_norm) * fed * h * inflated
    held = 0.25 * h * h * (second_rate * fed + cell.whole * stiff_rate + change * odd) * inflated + varied
    held = held + 0.375 * h * h * whole_stiffness * fed
    missed = h * h / 8.0 * cell.jerk + 0.25 * h * cell.jump
    return Suprema(
        conversion=conversion_sup,
        inverse=inverse,
        inertia=inertia,
        growth=0.5 * change,
        coriolis=coriolis,
        coriolis_rows=coriolis_rows,
        coriolis_entries=coriolis_entries,
        coriolis_torques=cell.torques(turn + cell.half * turn_rate, coriolis_shift - known),
        change_torques=cell.torques(rate + cell.half * rate_rate, change_shift - known),
        stiffness=stiffness,
        stiffness_entries=stiffness_entries,
        per_command=per_command * inflated[:, None],
        held=held,
        odd=odd,
        reference=(coriolis + h * stiffness) * missed,
        **_region_bounds(cell, change, motion_change, conversion_sup),
    )


def _region_bounds(cell: Cell, change: Floats, motion_change: Floats, conversion: Floats) -> dict[str, Floats]:
    """Return the suprema over the parameter region, by the field names of `Suprema`.

    - `change`: norm of Ṁ0 along the arm's own motion; `motion_change`: along the planned motion, in the metric of the
      centre.
    - `conversion`: as in `Suprema`.
    """
    path, cover, tube, at = cell.path, cell.cover, cell.tube, cell.path.region_norms
    p, half, inflated, grown = path.region.p, cell.half, cell.inflated, cell.grown

    # The torque of the band along the motion, and its rate, in the metric of the centre.
    rate_change = (
        cover.second * cover.force
        + cover.first * (2.0 * cover.bend + cover.reach * cell.jerk)
        + (cover.whole * cover.bend_rate)
    )
    rate_change = half * rate_change + 4.0 * cover.first * cover.whole * cell.jump
    rate = at.rate + rate_change + p * cell.jerk
    jump = p * cell.jump
    force = at.force + half * rate + jump
    band = force * grown
    band_rate = rate * grown + motion_change * inflated * band
    band_joints = at.joints + conversion * (half * band_rate + jump * inflated)[:, None]

    # The torque's change by the tube: by the mean derivatives between the motion and the arm.
    stiffness = at.stiffness + cover.stiffness_change(model=False)
    coriolis = at.coriolis + cover.coriolis_change(0.5 * tube.speed, 0.5 * tube.speed_norm)
    band_tube = (np.sum(stiffness * tube.position, axis=1) + coriolis * tube.speed_norm * grown) * grown
    band_tube = band_tube + (2.0 * cell.whole * cell.drift + cell.drift**2) * inflated * band

    # The rate of E along the motion; the rates along the arm's own motion and of M0⁻¹ E follow below.
    growth = at.growth + cover.coriolis_moved

    # E itself: its change along the motion and by the tube, and that of M0⁻¹.
    shift = half * growth + 2.0 * cover.whole * cover.drift + cover.drift**2
    spread = cell.shift * inflated * p * (1.0 + cell.shift)
    inverse, diagonal = cell.conversion[:, :, None], cell.diagonal[:, None]
    band_error = at.error + shift[:, None, None] * cell.diagonal[:, :, None] * diagonal
    band_torques = cell.torques(at.error_rows + half * at.error_rates, shift - half * at.growth)
    band_relative = at.relative + (shift + spread)[:, None, None] * inverse * diagonal

    # The torque per joint.
    torque_rate, torque_jump = (
        np.einsum("nij,nj->ni", band_error, part) for part in (path.cells.jerk, path.cells.jump)
    )
    torque_rate = (
        at.torque_rate
        + cell.weight * rate_change[:, None]
        + np.minimum(torque_rate, cell.weight * (p * cell.jerk)[:, None])
    )
    torque_jump = np.minimum(torque_jump, cell.weight * jump[:, None])
    band_torque = at.torque + np.minimum(half * torque_rate, cell.weight * (half * rate)[:, None]) + torque_jump

    growth = growth + np.sum(at.slopes * tube.speed, axis=1)
    further = cover.whole * (cover.crossed(tube.speed) + cover.moved) + cover.along * cover.sums(tube.speed)
    growth = growth + 2.0 * (further + cover.first * cover.drift)
    return {
        "slide": growth * inflated + p * change,
        "band": band,
        "band_joints": band_joints,
        "band_rate": band_rate,
        "band_tube": band_tube,
        "band_torque": band_torque,
        "torque_rate": torque_rate,
        "torque_jump": torque_jump,
        "band_error": band_error,
        "band_torques": band_torques,
        "band_relative": band_relative,
    }
