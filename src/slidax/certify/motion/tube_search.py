"""Search for error bounds along a motion, with a tube that contains them.

A tube has largest deviations from the motion (`Tube`). The bounds are computed from suprema of the model errors over a
tube (`Suprema`). So they are valid if the deviations that they allow stay inside that tube.
"""

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
"""Largest number of tubes in the search."""

PASSES, ROUNDS = 3, 3
"""Number of narrower tubes in which verified bounds are tightened, and rounds of the inequalities in each tube."""

WIDE, WIDE_TUBES = 1.25, 2
"""Factor on the width of the first tubes, and their number; the bounds in them are tightened afterwards."""


@dataclass(frozen=True, eq=False)
class Solution:
    """Error bounds along a motion, and the inequalities of the last tube, which verified bounds satisfy."""

    bounds: Bounds
    problem: Problem


def bounds_along(
    loop: JointLoop, path: Path, inputs: Inputs, *, cap: float = 0.05, hand_over: HandOverCells | None = None
) -> Solution | None:
    """Return error bounds along a motion, verified in a tube that contains them.

    If the search finds no verified bounds below `cap`, it returns unverified ones. The result is None if the inertia
    changes too much within a time cell, or faster than the loop settles.

    - `loop`: the linear loop of every joint. `path`: the arm along the motion.
    - `inputs`: bounds of friction, disturbance, noise and start.
    - `cap`: largest error bound of the search, rad or m.
    - `hand_over`: the nonlinear part of the law in each cell; None for a linear law.
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
        # If the metric's norms grow nearly as fast as the loop settles, no bound exists.
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
    """Return verified bounds in a tube that is `WIDE` times as wide as first bounds need; None if there are none."""
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
    """Tighten verified bounds in narrower tubes. A tube that contains the bounds suffices, and no bound grows."""
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
    """Return the factor by which to widen the next tube.

    The factor extrapolates the largest errors so far as a geometric series, with a margin.
    """
    if len(values) < 3:
        return 1.01
    last, before = values[-1] - values[-2], values[-2] - values[-3]
    ratio = min(max(last / max(before, TINY), 0.0), 0.9)
    return 1.01 + 0.5 * max(last, 0.0) * ratio / (1.0 - ratio) / values[-1]


def tube_of(bounds: Bounds, path: Path, h: float, at: Suprema) -> Tube:
    """Return the smallest tube that contains all states that the bounds allow.

    These are the states of the arm, and those at which the law evaluates its model.

    - `h`: period [s]. `at`: suprema from which the bounds were computed.
    """
    cells, outputs, norms = path.cells, bounds.outputs, bounds.norms
    # Largest difference at mid-period between the velocity planned with the period's mean acceleration and q̇_d.
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
