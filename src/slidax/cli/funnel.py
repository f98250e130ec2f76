"""A run in its envelope, drawn in a terminal."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from rich.console import Console
from rich.table import Table
from rich.text import Text

from slidax.figures.logged import log_of
from slidax.simulation import Run

from .dots import Dots

ROWS = 7
"""Of characters, for each joint."""

WIDEST = 58
"""Characters of a joint's picture, where there is room."""

INSIDE, OUTSIDE, BOUND = "bright_blue", "bold red", "dim"
"""How the error and its bounds look."""


def funnel(console: Console, run: Run, drawn: Run, share: float) -> Table:
    """The errors of all joints side by side, each in its bounds.

    The scale is linear about zero, as far as the bounds are apart in the end, and logarithmic farther out.

    - `console`: for its width, and whether it has more than ASCII.
    - `run`: with every sample logged.
    - `drawn`: the run of the law that has the envelope, with every sample logged.
    - `share`: how much of the time is drawn, 0 to 1.
    """
    joints = run.joints
    label = 6
    wide = max(12, min(WIDEST, (console.width - 2) // joints - label - 3))
    plain = not (console.encoding or "").lower().startswith("utf")
    table = Table.grid(padding=(0, 1))
    for _ in range(joints):
        table.add_column(width=label, justify="right", style=BOUND)
        table.add_column(width=wide)
    pictures = [_joint(run, drawn, joint, share, Dots(wide, ROWS, plain=plain)) for joint in range(joints)]
    for row in range(ROWS):
        cells: list[Text] = []
        for top, lines in pictures:
            cells += [Text({0: f"{top:+.1f}", ROWS // 2: "0", ROWS - 1: f"{-top:+.1f}"}.get(row, "")), lines[row]]
        table.add_row(*cells)
    return table


def _joint(run: Run, drawn: Run, joint: int, share: float, field: Dots) -> tuple[float, list[Text]]:
    """The error at the upper edge, and the rows."""
    bounds, log = log_of(drawn).envelope, log_of(run)
    assert bounds is not None
    lower, upper = np.asarray(bounds.lower)[:, joint], np.asarray(bounds.upper)[:, joint]
    error = np.asarray(log.e)[:, joint]
    knee = float(min(abs(lower[-1]), abs(upper[-1])))
    top = float(np.max(np.abs([lower, upper])))

    def place(value: np.ndarray) -> np.ndarray:
        size = np.arcsinh(1.15 * top / knee)
        return np.asarray(0.5 + 0.5 * np.arcsinh(value / knee) / size)

    edges = np.linspace(0, len(lower), field.across + 1).astype(int)
    for x, (first, end) in enumerate(pairwise(edges)):
        for side in (lower, upper):
            at = place(side[first:end])
            field.stroke(x, float(at.min()), float(at.max()), BOUND)
        seen = error[first : min(end, len(error))]
        seen = seen[np.isfinite(seen)]
        if x >= share * field.across or not len(seen):
            continue
        out = np.any((seen <= lower[first : first + len(seen)]) | (seen >= upper[first : first + len(seen)]))
        at = place(seen)
        field.stroke(x, float(at.min()), float(at.max()), OUTSIDE if out else INSIDE)
    return top, field.lines()
