"""The errors of a run inside the envelope, drawn in a terminal."""

from __future__ import annotations

import numpy as np
import plotille
from rich.console import Console
from rich.table import Table
from rich.text import Text

from slidax.report.figures.style import log_of, thin_curve
from slidax.simulation.run import Run

ROWS = 7
"""Height of a joint's plot [lines]."""

WIDEST = 58
"""Largest width of a joint's plot [characters]."""

LABEL = 6
"""Width of the axis labels [characters]."""

INSIDE, OUTSIDE, BOUND = "bright_blue", "bright_red", "bright_black"


def funnel(console: Console, run: Run, envelope_run: Run, share: float) -> Table:
    """Return a table with one text plot per joint, side by side: the error over time, and its envelope.

    The vertical scale is linear near zero, within the final bounds, and logarithmic farther out.

    - `console`: the console that prints the table, for its width and encoding.
    - `run`: the run whose error is drawn, with every sample logged.
    - `envelope_run`: the run whose envelope is drawn; it may differ if `run` has a law without an envelope.
    - `share`: share of the run's time to draw, 0 to 1.
    """
    width = max(12, min(WIDEST, (console.width - 2) // run.joints - LABEL - 3))
    ascii_only = not (console.encoding or "").lower().startswith("utf")
    table = Table.grid(padding=(0, 1))
    plots = []
    for joint in range(run.joints):
        table.add_column(width=LABEL, justify="right", style="dim")
        table.add_column(width=width)
        plots.append(_plot(run, envelope_run, joint, share, width, ascii_only))
    for row in range(ROWS):
        cells: list[Text] = []
        for top, lines in plots:
            labels = {0: f"{top:+.1f}", ROWS // 2: "0", ROWS - 1: f"{-top:+.1f}"}
            cells += [Text(labels.get(row, "")), Text.from_ansi(lines[row])]
        table.add_row(*cells)
    return table


def _plot(
    run: Run, envelope_run: Run, joint: int, share: float, width: int, ascii_only: bool
) -> tuple[float, list[str]]:
    """Return the largest bound of a joint, for the axis labels, and the lines of its plot."""
    bounds, t = log_of(envelope_run).envelope, np.asarray(log_of(envelope_run).t)
    assert bounds is not None
    lower, upper = np.asarray(bounds.lower)[:, joint], np.asarray(bounds.upper)[:, joint]
    knee = float(min(abs(lower[-1]), abs(upper[-1])))
    top = float(np.max(np.abs([lower, upper])))
    canvas = plotille.Canvas(width, ROWS, xmin=float(t[0]), xmax=float(t[-1]), ymin=-1.0, ymax=1.0)

    def draw(times: np.ndarray, values: np.ndarray, colour: str) -> None:
        if len(times) < 2:
            return
        heights = np.arcsinh(values / knee) / np.arcsinh(1.15 * top / knee)
        # Values far outside end at the edge, which cuts them off.
        x, y = thin_curve(times, np.clip(heights, -1.5, 1.5), columns=2 * width)
        for k in range(len(x) - 1):
            canvas.line(float(x[k]), float(y[k]), float(x[k + 1]), float(y[k + 1]), color=colour)

    draw(t, lower, BOUND)
    draw(t, upper, BOUND)
    count = min(len(t), len(np.asarray(log_of(run).t)), int(share * len(t)))
    error = np.asarray(log_of(run).e)[:count, joint]
    error = error[np.cumprod(np.isfinite(error)).astype(bool)]
    inside = (lower[: len(error)] < error) & (error < upper[: len(error)])
    changes = np.flatnonzero(np.diff(inside)) + 1
    for start, end in zip([0, *changes], [*changes, len(error)], strict=True):
        if start < end:
            part = slice(start, end + 1)
            draw(t[: len(error)][part], error[part], INSIDE if inside[start] else OUTSIDE)
    text = canvas.plot(linesep="\n")
    if ascii_only:
        text = "".join(" " if c == "\u2800" else "*" if "\u2800" < c < "\u2900" else c for c in text)
    return top, text.split("\n")
