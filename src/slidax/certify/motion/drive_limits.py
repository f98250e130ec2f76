"""Bounds of the commanded torque and of its step from one period to the next, in each time cell of a motion.

The commanded torque is the sum of three parts:

- the torque of the planned motion;
- `M0 s`, with the nominal inertia M0 and the law's feedback acceleration s;
- the change of the model's torque, since the law evaluates its model at a predicted state and not on the plan.

`M0 s` has two bounds, of which the smaller is used:

- by the size of s: `Σ_j |M0_ij| |s_j|`;
- by torques: in the nominal loop s is the convolution `s = S * w` of the disturbance w with one scalar kernel S for all
  joints. So `M0 s` is the response to the torque `M0 w`, apart from the change of M0 in the kernel's memory. Friction,
  disturbances and the inertial band count as torques of their own joint, and not through `|M0| |M0⁻¹|`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from slidax.arms.articulated import Articulated

from .fixed_point import USED, Bounds, Problem
from .lagged_sums import SUMMED, Lags
from .path_cells import PathCells
from .path_norms import size_in
from .path_tube import Cell
from .tube_search import Solution

Floats = NDArray[np.float64]

BATCH = 512
"""The torques of the plan are computed for this number of periods at once, so that one program is compiled."""


@dataclass(frozen=True, eq=False)
class DriveBounds:
    """Bounds in each cell [cells n], N m or N.

    - `torque`: commanded torque; `step`: change of the commanded torque from one period to the next.
    - `planned_torque`, `planned_step`: the torque of the planned motion alone, and its change in a period.
    - `step_terms`: shares of `step` by name; their sum is at least `step`.
    """

    torque: Floats
    step: Floats
    planned_torque: Floats
    planned_step: Floats
    step_terms: Mapping[str, Floats]


def drive_bounds(arm: Articulated, solution: Solution) -> DriveBounds:
    """Return the bounds of the commanded torque and of its step along a path.

    - `arm`: the nominal arm. `solution`: verified error bounds.
    """
    problem, bounds = solution.problem, solution.bounds
    planned, planned_step = planned_torques(arm, problem.path.cells)
    torques = Torques(problem, bounds)
    by_size = np.einsum("nij,nj->ni", problem.at.inertia, bounds.outputs["command"])
    command = np.minimum(by_size, np.asarray(sum(torques.commanded("command").values())))
    torque = planned + command + torques.moved("model_position", "model_velocity")
    step_by_size = np.einsum("nij,nj->ni", problem.at.inertia, bounds.outputs["command_step"])
    shares = torques.commanded("command_step")
    step = np.minimum(step_by_size, np.asarray(sum(shares.values())))
    more = {"plan": planned_step, "change of inertia": torques.turning(), "model": torques.state_step()}
    return DriveBounds(torque, step + sum(more.values()), planned, planned_step, {**shares, **more})


def planned_torques(arm: Articulated, cells: PathCells) -> tuple[Floats, Floats]:
    """Return the planned motion's largest torque and torque step in each cell [cells n], as the law computes them.

    The first step is relative to `C0 q̇ + G0` of the nominal arm at the start, the earlier torque that the law assumes.
    """
    h, count = cells.period, len(cells.q) * cells.per_cell
    q, dq, *_ = cells.pieces.at(np.asarray(np.arange(count + 2) * h, float))
    mean = np.diff(dq, axis=0) / h
    middle_q = q[:-1] + 0.5 * h * dq[:-1] + 0.125 * h * h * mean
    middle_dq = dq[:-1] + 0.5 * h * mean
    padding = -(count + 1) % BATCH
    parts = [np.pad(part, ((0, padding), (0, 0)), mode="edge") for part in (middle_q, middle_dq, mean)]
    batches = zip(*(part.reshape(-1, BATCH, arm.joints) for part in parts), strict=True)
    torque = np.concatenate([_torques(arm, *batch) for batch in batches])[: count + 1]
    torque = torque + np.asarray(arm.viscous) * middle_dq
    held = np.asarray(arm.bias(jnp.asarray(q[0]), jnp.asarray(dq[0])))
    step = np.abs(np.diff(torque, axis=0, prepend=held[None]))
    # A step between two cells counts in both.
    step = np.maximum(step[:-1], step[1:])
    shape = (len(cells.q), cells.per_cell, -1)
    return np.abs(torque[:-1]).reshape(shape).max(axis=1), step.reshape(shape).max(axis=1)


@jax.jit
def _torques(arm: Any, q: Any, dq: Any, ddq: Any) -> Any:
    return jax.vmap(lambda q, dq, ddq: arm.mass(q) @ ddq + arm.bias(q, dq))(q, dq, ddq)


class Torques:
    """Bounds of the torques that disturb the joints' loops, and of the commanded torques that follow from them."""

    def __init__(self, problem: Problem, bounds: Bounds) -> None:
        """Compute the bounds of the torques from verified bounds of the outputs."""
        self.problem, self.bounds, self.at = problem, bounds, problem.at
        self.cell = cell = Cell(problem.path, problem.tube)
        path, at, inputs, cells, weight = problem.path, problem.at, problem.inputs, problem.path.cells, cell.weight
        diagonals = cell.diagonal[:, :, None] * cell.diagonal[:, None]
        self.coriolis = np.abs(path.coriolis) + cell.coriolis_shift[:, None, None] * diagonals
        self.stiffness = np.abs(path.stiffness) + cell.diagonal[:, :, None] * cell.stiffness_shift[:, None]
        outputs, norms = bounds.outputs, bounds.norms
        limited = bool(np.all(np.isfinite(inputs.torque_rate)))
        torque, torque_rate = (np.broadcast_to(x, cells.speed.shape) for x in (inputs.torque, inputs.torque_rate))
        friction = inputs.coulomb + inputs.viscous_error * cells.speed
        friction = friction + inputs.viscous * (bounds.velocity + 0.5 * cells.period * cells.acceleration)
        further = np.sum(at.per_command * outputs["position_miss"], axis=1) * norms["command"]
        moving = norms["acceleration"] + problem.acting
        self.acting = {
            "friction": np.broadcast_to(friction, cells.speed.shape),
            "disturbance": np.zeros_like(torque) if limited else torque,
            "band feedback": np.minimum(
                at.band_torques * moving[:, None],
                np.einsum("nij,nj->ni", at.band_error, outputs["acceleration"] + problem.unplanned),
            ),
            "prediction": self.moved("position_miss", "velocity_miss") + weight * further[:, None],
            "sampling": weight * (at.held + at.reference)[:, None],
            "inertial band": weight * at.band_tube[:, None],
        }
        self.slow = at.band_torque + (torque if limited else 0.0)
        self.slow_rate = at.torque_rate + (torque_rate if limited else 0.0)
        self.total_norm = bounds.disturbance_norm + problem.p * moving + at.band + problem.pushed_norm

    def commanded(self, name: str) -> dict[str, Floats]:
        """Return shares of a bound of |M0 x| by name [cells n], N m or N, for an output x of the joints' loops.

        The sum of the shares is the bound. Each share has the name of its cause, such as `friction`.

        - `name`: x: `command`, `command_step`, `estimate`, `sliding` or another output whose kernel has `beyond` 0.
        """
        problem, at, inputs, cells = self.problem, self.at, self.problem.inputs, self.problem.path.cells
        i, table = USED.index(name), problem.nominal
        h, shape = cells.period, cells.speed.shape

        def past(lags: Lags, values: Floats, which: int = i) -> Floats:
            return lags.past(values)[..., which]

        def weighed(joints: Floats) -> Floats:
            return np.einsum("nij,nj->ni", at.inertia, joints)

        shares = {key: past(table.any_form, value) for key, value in self.acting.items()}
        # The law follows a slow w: s = -w + (s + w), and the step of s is the step of -w plus that of s + w.
        followed = USED.index("acceleration") if name == "command" else i
        moving = past(table.ramp, self.slow_rate, followed) + (self.slow if name == "command" else 0.0)
        begun = at.torque_jump.copy()
        begun[0] += 0.0 if inputs.settled else self.slow[0]
        moving = moving + table.step.since(begun)[..., i]
        shares["inertial band"] = shares["inertial band"] + np.minimum(past(table.any_form, self.slow), moving)
        shares["encoder"] = weighed(past(table.noise, np.broadcast_to(0.5 * inputs.resolution, shape)))
        odd = past(problem.weighted.pulse, (h**3 / 12.0 / (1.0 - problem.p) * at.odd)[:, None])
        shares["sampling"] = shares["sampling"] + weighed(past(table.pulse, cells.pulse)) + self.cell.weight * odd
        starts = np.zeros((3, *shape))
        missed = 0.0 if inputs.settled else 0.5 * inputs.resolution
        starts[:, 0] = np.stack(np.broadcast_arrays(inputs.start_error, inputs.start_speed, missed))
        begins = zip((table.start_error, table.start_speed, table.start_miss), starts, strict=True)
        shares["start"] = weighed(np.sum([lags.since(start)[..., i] for lags, start in begins], axis=0))
        if problem.hand_over is not None:
            shares["hand-over"] = weighed(past(table.goal, problem.hand_over.goal(self.bounds.outputs["led"])))
        # Difference between M0 where the model is evaluated now and M0 at the arm's position when w acted.
        kernel = problem.stacks["nominal"].summed[:, SUMMED.index("any_form"), i, None]
        ages = (h * (1.0 + np.arange(len(kernel))))[:, None]
        turning = Lags.of(kernel * ages * np.exp(problem.growth * ages), *problem.cut)
        missed = self.bounds.outputs["position_miss"] + h * h * (h / 8.0 * cells.jerk + 0.25 * cells.jump)
        missed = self.cell.weight * np.sum(at.per_command * missed, axis=1)[:, None]
        shares["drift"] = turning.past_change(at.change_torques, self.total_norm)
        shares["drift"] = shares["drift"] + missed * past(problem.weighted.any_form, self.total_norm[:, None])
        return shares

    def moved(self, position: str, velocity: str) -> Floats:
        """Return a bound of the model torque's change with the state at which the model is evaluated [cells n].

        The part due to the feedback acceleration s is left out.

        - `position`, `velocity`: names of the outputs that bound this state's changes, such as `model_position`.
        """
        outputs, norms = self.bounds.outputs, self.bounds.norms
        turned = np.einsum("nij,nj->ni", self.coriolis, outputs[velocity])
        turned = np.minimum(turned, self.at.coriolis_torques * norms[velocity][:, None])
        return turned + np.einsum("nij,nj->ni", self.stiffness, outputs[position])

    @cached_property
    def moves(self) -> tuple[Floats, Floats, Floats]:
        """Bounds of the change, in a period, of the deviation of the model's state from the motion.

        The model's state is that at which the law evaluates its model. The bounds are those of the position and of the
        velocity [cells n], and of the velocity's norm [cells]. They include the difference between the mean
        acceleration that the law plans for a period and the motion's own.
        """
        cells, h = self.problem.path.cells, self.problem.path.cells.period
        place, speed = self.bounds.outputs["model_position_step"], self.bounds.outputs["model_velocity_step"]
        off = h * (0.5 * h * cells.jerk + cells.jump)
        norm = self.bounds.norms["model_velocity_step"] + size_in(off, self.at.inertia)
        return place + h * off, speed + off, norm

    def turning(self) -> Floats:
        """Return a bound of the feedback torque's change in a period that is due to M0's change [cells n]."""
        turned = self.cell.weight * np.sum(self.at.per_command * self.moves[0], axis=1)[:, None]
        change = self.problem.path.cells.period * self.at.change_torques + turned
        return change * self.bounds.norms["command"][:, None]

    def state_step(self) -> Floats:
        """Return a bound of the change, in a period, of the model's torque less its torque on the plan [cells n].

        The part due to the feedback acceleration is left out. Two changes add up: of the state at which the model is
        evaluated, and of the torque's derivatives `2 C` by velocity and P by position. The change of `2 C` is its rate
        along the motion at the cell's centre, plus a remainder. The change of P is bounded by columns.
        """
        outputs, norms, cell, at = self.bounds.outputs, self.bounds.norms, self.cell, self.at
        path, tube, cells, sums, vectors = cell.path, cell.tube, cell.path.cells, cell.sums, cell.vectors
        first, second, turned, place = cell.first, cell.second, cell.moved + cell.slopes[1], tube.position
        (moved, faster, faster_norm), h = self.moves, cells.period
        rate = 2.0 * cell.half * (3.0 * first * second + cell.third * cell.whole) + 2.0 * cell.whole * sums(cells.jump)
        more = (
            sums(place, cell.wide[1], cell.speed) + sums(place, cell.acceleration) + sums(tube.model_speed, cell.speed)
        )
        rate = rate + 2.0 * (cell.moved * (first + turned) + first * turned + cell.drift * second + cell.whole * more)
        step = sums(moved) * (first + turned) + cell.whole * sums(moved, cell.wide[1]) + cell.turn(faster, faster_norm)
        changed = cell.torques(h * path.torques[1], h * rate + 2.0 * step) * norms["model_velocity"][:, None]
        # Steps of the position, velocity and acceleration at which the model is evaluated.
        wide, whole, gone = cell.wide[1], cell.acceleration, h * cell.speed + moved
        planned = h * (cell.acceleration + cells.jump)
        faster_norm = faster_norm + size_in(planned, at.inertia)
        pushed = size_in(h * cells.jerk + cells.jump, at.inertia)
        force, force_step = cell.force + cell.forces[1], vectors(gone, wide, wide) + vectors(gone, whole)
        force_step = force_step + 2.0 * (first + turned) * faster_norm * cell.grown
        stiffness = (
            cell.sums_each(gone) * force[:, None]
            + cell.outer * force_step[:, None]
            + sums(gone)[:, None] * (cell.vectors_each(wide, wide) + cell.vectors_each(whole))
            + (1.0 + cell.along)[:, None]
            * (
                cell.vectors_each(gone, wide, wide)
                + cell.vectors_each(gone, whole)
                + 2.0 * cell.sums_each(wide) * (faster_norm * cell.grown)[:, None]
            )
        )
        stiffness = stiffness + at.per_command * pushed[:, None]
        changed = changed + self.cell.weight * np.sum(stiffness * outputs["model_position"], axis=1)[:, None]
        return self.moved("model_position_step", "model_velocity_step") + changed
