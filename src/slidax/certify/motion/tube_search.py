"""Search for a tube around a motion that contains the bounds which hold in it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from .fixed_point import TINY, Bounds, Inputs, Problem
from .hand_over import HandOverCells
from .joint_loop import JointLoop
from .path import Path
from .path_norms import size_in
from .path_suprema import Suprema, suprema
from .path_tube import Tube

TUBES = 16
"""Tubes that are tried."""

PASSES, ROUNDS = 3, 3
"""Times that verified bounds are tightened by a narrower tube, and rounds in each."""

WIDE, WIDE_TUBES = 1.25, 2
"""Factor on the first tubes that are tried, and their number; the bounds in them are tightened afterwards."""


@dataclass(frozen=True, eq=False)
class Solution:
    """Bounds along a path, with the inequalities that they satisfy and their suprema."""

    bounds: Bounds
    problem: Problem


def bounds_along(
    loop: JointLoop, path: Path, inputs: Inputs, *, cap: float = 0.05, hand_over: HandOverCells | None = None
) -> Solution | None:
    """Return the bounds along a path, with a tube that contains them; unverified if there are none below `cap`.

    - `hand_over`: the nonlinear part of the law in each cell; None for a linear law.

    None if the inertia changes too much within a cell.
    """
    wide = _in_a_wide_tube(loop, path, inputs, cap, hand_over)
    if wide is not None:
        return wide
    tube = Tube.none(path.cells)
    bounds: Bounds | None = None
    problem: Problem | None = None
    steps: list[float] = []
    for _ in range(TUBES):
        at = suprema(path, tube)
        # Norms that grow nearly as fast as the loop forgets leave no bound.
        if at is None or np.max(at.growth) > 0.5 * loop.decay:
            break
        problem = Problem(loop, path, inputs, at, tube, hand_over)
        bounds = problem.solve(bounds, cap)
        if not bounds.verified:
            return Solution(bounds, problem)
        needed = tube_of(bounds, path, loop.period, at)
        if _contains(tube, needed):
            return _tightened(Solution(bounds, problem), needed)
        steps.append(float(bounds.error.max()))
        if len(steps) > 3 and steps[-1] - steps[-2] > steps[-2] - steps[-3] > steps[-3] - steps[-4]:
            break
        tube = Tube(**{name: value * _ahead(steps) for name, value in vars(needed).items()})
    if bounds is None or problem is None:
        return None
    return Solution(replace(bounds, verified=False), problem)


def _in_a_wide_tube(
    loop: JointLoop, path: Path, inputs: Inputs, cap: float, hand_over: HandOverCells | None
) -> Solution | None:
    """Verified bounds by a tube that is wider than what the bounds without a tube need; None if that is none."""
    tube, bounds = Tube.none(path.cells), None
    for tries in range(1 + WIDE_TUBES):
        at = suprema(path, tube)
        if at is None or np.max(at.growth) > 0.5 * loop.decay:
            return None
        problem = Problem(loop, path, inputs, at, tube, hand_over)
        bounds = problem.solve(bounds, cap) if tries else problem.approach(cap)
        if bounds is None or (tries and not bounds.verified):
            return None
        needed = tube_of(bounds, path, loop.period, at)
        if tries and _contains(tube, needed):
            return _tightened(Solution(bounds, problem), needed)
        tube = Tube(**{name: value * WIDE for name, value in vars(needed).items()})
    return None


def _contains(tube: Tube, needed: Tube) -> bool:
    return all(np.all(getattr(needed, name) <= getattr(tube, name)) for name in vars(tube))


def _tightened(solution: Solution, needed: Tube) -> Solution:
    """Bounds by narrower tubes: a tube that the bounds need suffices, and no bound grows."""
    bounds, last = solution.bounds, solution.problem
    for _ in range(PASSES):
        at = suprema(last.path, needed)
        if at is None:
            break
        last = Problem(last.loop, last.path, last.inputs, at, needed, last.hand_over)
        for _ in range(ROUNDS):
            bounds = replace(last.round(bounds), verified=True)
        needed = tube_of(bounds, last.path, last.loop.period, at)
    return Solution(bounds, last)


def _ahead(values: list[float]) -> float:
    """Factor by which a tube is widened: to the limit of a geometric series of its widths, and some more."""
    if len(values) < 3:
        return 1.01
    last, before = values[-1] - values[-2], values[-2] - values[-3]
    ratio = min(max(last / max(before, TINY), 0.0), 0.9)
    return 1.01 + 0.5 * max(last, 0.0) * ratio / (1.0 - ratio) / values[-1]


def tube_of(bounds: Bounds, path: Path, h: float, at: Suprema) -> Tube:
    """Return the tube that contains the arm and the model's arguments within the bounds."""
    cells, outputs, norms = path.cells, bounds.outputs, bounds.norms
    # The reference's own miss at the middle of a period.
    missed = h * h / 8.0 * cells.jerk + 0.25 * h * cells.jump
    speed_norm = norms["velocity"] * (1.0 + h * at.growth) + h * (
        norms["acceleration"] + size_in(0.5 * h * cells.jerk + cells.jump, at.inertia)
    )
    return Tube(
        position=np.maximum(bounds.error, outputs["model_position"] + h * missed),
        speed=bounds.velocity,
        speed_norm=np.minimum(size_in(bounds.velocity, at.inertia), speed_norm),
        model_speed=outputs["model_velocity"] + missed,
        model_norm=norms["model_velocity"] + size_in(missed, at.inertia),
        command=outputs["command"],
        command_norm=norms["command"],
        acceleration=outputs["command"] + outputs["acceleration"],
        acceleration_norm=norms["command"] + norms["acceleration"],
    )
