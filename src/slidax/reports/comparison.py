"""The report of several schemes on the same task."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from itertools import groupby, islice
from pathlib import Path
from typing import Any

import numpy as np

from slidax import figures
from slidax._errors import DefinitionError
from slidax._writing import write_text
from slidax.figures.overlay import LOOKS
from slidax.metrics import Metric, short_names
from slidax.simulation import Run

from .machine import machine, versions
from .page import render
from .parameters import parameters
from .picture import Picture, picture
from .rival import Rival
from .standings import Row, results, standings
from .tip_paths import tip_paths
from .torque_limits import torque_limits

ACROSS = 5
"""How many schemes stand side by side in a table."""


def write_comparison(
    rivals: Mapping[str, Rival], out: Path, *, also: Sequence[Metric[Any]] = (), command: str = ""
) -> Path:
    """Writes `out/report.html`, `out/figures/*.svg` and `out/results.json`, and returns the path of the page.

    - `rivals`: each scheme with its run, by name; runs without a log are in the tables only.
    - `out`: a folder, made if missing.
    - `also`: further metrics, such as those of a paper; shown for scenarios of their source.
    - `command`: the command that did it, for the page.

    Raises DefinitionError if there are no runs, or not all of them are of the same arm.
    """
    if not rivals:
        raise DefinitionError("there is nothing to compare: give at least one run")
    first = next(iter(rivals.values()))
    if any(rival.run.joint_names != first.run.joint_names for rival in rivals.values()):
        raise DefinitionError("only runs of the same arm can be compared; these have different joints")
    out.mkdir(parents=True, exist_ok=True)
    rows = standings(rivals, also)
    timings = [rival.run.timing for rival in rivals.values() if rival.run.timing]
    values = {
        "scenario": first.scenario,
        "rivals": rivals,
        "shares": _shares(list(rivals)),
        "groups": [(metric, list(group)) for metric, group in groupby(rows, key=lambda row: row.metric)],
        "pictures": _pictures(rivals, rows, out / "figures"),
        "undrawn": [name for name in rivals if name not in _drawn(rivals)],
        "parameters": {name: parameters(rival.scenario) for name, rival in rivals.items()},
        "versions": versions(),
        "machine": machine(),
        "seconds": sum(timing.compile_s + timing.run_s for timing in timings),
        "command": command,
    }
    text = json.dumps(results(rivals, also), indent=2, allow_nan=False, ensure_ascii=False)
    write_text(out / "results.json", text + "\n")
    page = out / "report.html"
    write_text(page, render("comparison.html.j2", values))
    return page


def _shares(names: list[str]) -> list[list[str]]:
    """The names in as few tables as fit on paper, none much shorter than the others."""
    tables = -(-len(names) // ACROSS)
    each = -(-len(names) // tables)
    return [names[start : start + each] for start in range(0, len(names), each)]


def _drawn(rivals: Mapping[str, Rival]) -> dict[str, Rival]:
    """Those with something to draw, and no more than there are looks."""
    return dict(islice(((name, rival) for name, rival in rivals.items() if _has_samples(rival.run)), len(LOOKS)))


def _has_samples(run: Run) -> bool:
    if run.log is None:
        return False
    samples = np.concatenate([np.asarray(part) for part in (run.log.e, run.log.de, run.log.tau)], axis=1)
    return int(np.isfinite(samples).all(axis=1).sum()) >= 2


def _pictures(rivals: Mapping[str, Rival], rows: list[Row], folder: Path) -> list[Picture]:
    drawn = _drawn(rivals)
    if not drawn:
        return []
    runs = {name: rival.run for name, rival in drawn.items()}
    ways = {name: tip_paths(rival.scenario.plant.robot, rival.run) for name, rival in drawn.items()}
    desired = max((goal for _, goal in ways.values()), key=len)
    promised = [name for name, run in runs.items() if run.has_envelope]
    behind = f" Behind them lies the envelope of {promised[0]}." if len(promised) == 1 else ""
    made = [
        (
            "tracking-errors",
            "Tracking errors",
            "At the beginning, and their sizes over the run, each at the largest sample of a short time." + behind,
            figures.compared_errors(runs),
        ),
        (
            "velocity-errors",
            "Velocity errors",
            "At the beginning, and their sizes over the run, drawn in the same way.",
            figures.compared_velocity_errors(runs),
        ),
        (
            "torques",
            "Torques",
            "Over the whole run, and at the beginning. A tinted band is the range of a torque that chatters; "
            "peaks far above all others leave the picture.",
            figures.compared_torques(runs, limits=torque_limits(next(iter(drawn.values())).scenario)),
        ),
        (
            "tip-paths",
            "Paths of the tip",
            "Over the desired path; each starts at a ring.",
            figures.compared_tip_paths({name: way for name, (way, _) in ways.items()}, desired),
        ),
    ]
    for metric, group in groupby((row for row in rows if row.metric.bars), key=lambda row: row.metric):
        found = list(group)
        bars = {name: [row.values[name] for row in found] for name in drawn}
        units = ", ".join(dict.fromkeys(row.unit for row in found))
        joints = short_names([row.joint for row in found])
        caption = f"{metric.meaning}, joint by joint on a logarithmic axis."
        figure = figures.metric_bars(bars, f"{metric.title}  [{units}]", joints)
        made.append((metric.key, metric.title.capitalize(), caption, figure))
    return [picture(figure, folder, name, title, caption) for name, title, caption, figure in made]
