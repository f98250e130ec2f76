"""Metrics of the tool, for a run whose joints lead one along a path."""

from __future__ import annotations

from typing import Any

import numpy as np

from slidax.simulation import Run

from .error import reached_last_quarter
from .metric import array_of, arrays, metric, of_the_run, root


@metric("tool error", "m", per_joint=False)
def tool_error(run: Run) -> np.ndarray | float | None:
    """Most that the tip is away from where the reference has it [m]; None where no tool is led."""
    if run.tally.tool is None:
        return None
    return of_the_run(array_of(run.tally.samples) > 0, array_of(run.tally.tool.place.error))


@metric("steady tool error", "m", per_joint=False)
def steady_tool_error(run: Run) -> np.ndarray | float | None:
    """The same over the last quarter of the run [m]."""
    if run.tally.tool is None:
        return None
    return of_the_run(reached_last_quarter(run), array_of(run.tally.tool.place.steady))


@metric("tool error, rms", "m", per_joint=False)
def rms_tool_error(run: Run) -> np.ndarray | float | None:
    """Root mean square of that distance over all samples [m]."""
    if run.tally.tool is None:
        return None
    samples = array_of(run.tally.samples)
    return of_the_run(samples > 0, _rms(run, run.tally.tool.place.square))


@metric("tool turn", "rad", per_joint=False)
def tool_turn(run: Run) -> np.ndarray | float | None:
    """Largest angle of the rotation between the tool and how the reference has it [rad]; None where no tool is led."""
    turn = None if run.tally.tool is None else run.tally.tool.turn
    return None if turn is None else of_the_run(array_of(run.tally.samples) > 0, array_of(turn.error))


@metric("steady tool turn", "rad", per_joint=False)
def steady_tool_turn(run: Run) -> np.ndarray | float | None:
    """The same over the last quarter of the run [rad]."""
    turn = None if run.tally.tool is None else run.tally.tool.turn
    return None if turn is None else of_the_run(reached_last_quarter(run), array_of(turn.steady))


@metric("tool turn, rms", "rad", per_joint=False)
def rms_tool_turn(run: Run) -> np.ndarray | float | None:
    """Root mean square of that angle over all samples [rad]."""
    turn = None if run.tally.tool is None else run.tally.tool.turn
    if turn is None:
        return None
    samples = array_of(run.tally.samples)
    return of_the_run(samples > 0, _rms(run, turn.square))


def _rms(run: Run, square: Any) -> Any:
    """The root of a sum of squares over all samples."""
    xp = arrays(run)
    return root(xp, array_of(square) / xp.maximum(array_of(run.tally.samples), 1).astype(float))
