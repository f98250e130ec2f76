"""Tracking errors of several schemes on the same task."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from slidax.simulation import Run

from .logged import log_of
from .overlay import name_runs
from .paired import draw_pairs
from .style import BAND, BOUND, envelope_patch, styled
from .thinning import every_nth

LEVEL: dict[str, Any] = {"color": "0.1", "linewidth": 0.6, "linestyle": "-", "zorder": 3}


@styled
def compared_errors(
    runs: Mapping[str, Run], *, bands: Mapping[str, Sequence[float]] | None = None, beginning: float = 2.0
) -> Figure:
    """Per joint: the errors of all runs at the beginning, and to the right their sizes over the whole run.

    A size is drawn at the largest sample of each column, so that an oscillation about zero is a line. The envelope is
    drawn faintly if exactly one run has one.

    - `runs`: of the same arm, with logs, by name.
    - `bands`: levels of |e| by name, one value per joint [rad or m].
    - `beginning`: [s].

    Raises DefinitionError if there are no runs, too many, one without a log, or arms with different joints.
    """
    figure, panels = draw_pairs(runs, "e", "e_{%d}", "", beginning)
    more: list[Any] = [Line2D([], [], **LEVEL, label=name) for name in bands or {}]
    promised = [name for name, run in runs.items() if log_of(run).envelope is not None]
    if len(promised) == 1:
        _draw_envelope(panels, runs[promised[0]], beginning)
        more.append(envelope_patch(f"envelope of {promised[0]}"))
    for level in (bands or {}).values():
        for axes, height in zip(panels[:, 1], level, strict=True):
            axes.axhline(height, **LEVEL)
    name_runs(figure, runs, more)
    return figure


def _draw_envelope(panels: np.ndarray, run: Run, beginning: float) -> None:
    """In the background, and without widening the axes."""
    log = log_of(run)
    if log.envelope is None:
        return
    t, lower, upper = (np.asarray(part) for part in (log.t, log.envelope.lower, log.envelope.upper))
    first = t <= max(beginning, float(t[1]))
    for i, (plain, logarithmic) in enumerate(panels):
        _fill(plain, every_nth(t[first]), every_nth(lower[first, i]), every_nth(upper[first, i]))
        wide = every_nth(np.maximum(np.abs(lower[:, i]), np.abs(upper[:, i])))
        _fill(logarithmic, every_nth(t), np.full_like(wide, logarithmic.get_ylim()[0]), wide)


def _fill(axes: Axes, t: np.ndarray, low: np.ndarray, high: np.ndarray) -> None:
    limits = axes.get_ylim()
    axes.fill_between(t, low, high, **BAND, zorder=0.4)
    for edge in (low, high):
        axes.plot(t, edge, **{**BOUND, "linewidth": 0.5}, zorder=0.5)
    axes.set_ylim(limits)
