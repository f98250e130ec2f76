"""Velocity errors of several schemes on the same task."""

from __future__ import annotations

from collections.abc import Mapping

from matplotlib.figure import Figure

from slidax.simulation import Run

from .overlay import name_runs
from .paired import draw_pairs
from .style import styled


@styled
def compared_velocity_errors(runs: Mapping[str, Run], *, beginning: float = 2.0) -> Figure:
    """Per joint: the velocity errors of all runs at the beginning, and to the right their sizes over the whole run.

    - `runs`: of the same arm, with logs, by name.
    - `beginning`: [s].

    Raises DefinitionError if there are no runs, too many, one without a log, or arms with different joints.
    """
    figure, _ = draw_pairs(runs, "de", r"\dot{e}_{%d}", "/s", beginning)
    name_runs(figure, runs)
    return figure
