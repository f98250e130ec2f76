"""The page that compares several schemes on the same task."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import groupby, islice
from pathlib import Path
from typing import Any

import numpy as np

from slidax import figures
from slidax._errors import DefinitionError
from slidax.figures.overlay import LOOKS
from slidax.metrics import Metric, short_names
from slidax.simulation import Run

from .page import write_page
from .parameters import parameters
from .picture import Picture, picture
from .rival import Rival
from .standings import Row, results, standings
from .tip_paths import tip_paths
from .torque_limits import torque_limits

ACROSS = 5
"""Schemes side by side in a table."""


def write_comparison(
    rivals: Mapping[str, Rival], out: Path, *, also: Sequence[Metric[Any]] = (), command: str = ""
) -> Path:
    """Write `report.html`, `figures/*.svg` and `results.json` to the folder `out`, and return the page's path.

    - `rivals`: runs by scheme; a run without a log appears in the tables only.
    - `also`: further metrics, such as those of a paper; listed for scenarios from their source.
    - `command`: command line, for the page.

    Raises DefinitionError if there are no runs, or they belong to different arms.
    """
    if not rivals:
        raise DefinitionError("nothing to compare: give at least one run")
    first = next(iter(rivals.values()))
    if any(rival.run.joint_names != first.run.joint_names for rival in rivals.values()):
        raise DefinitionError("only runs of the same arm can be compared; these runs have different joints")
    rows = standings(rivals, also)
    timings = [rival.run.timing for rival in rivals.values() if rival.run.timing]
    return write_page(
        out,
        "comparison.html.j2",
        data={"results.json": results(rivals, also)},
        scenario=first.scenario,
        rivals=rivals,
        tables=_tables(list(rivals)),
        groups=[(metric, list(group)) for metric, group in groupby(rows, key=lambda row: row.metric)],
        pictures=_pictures(rivals, rows, out / "figures"),
        undrawn=[name for name in rivals if name not in _drawable(rivals)],
        parameters={name: parameters(rival.scenario) for name, rival in rivals.items()},
        seconds=sum(timing.compile_s + timing.run_s for timing in timings),
        command=command,
    )


def _tables(names: list[str]) -> list[list[str]]:
    """The names in as few tables as fit on paper, of nearly equal length."""
    tables = -(-len(names) // ACROSS)
    each = -(-len(names) // tables)
    return [names[start : start + each] for start in range(0, len(names), each)]


def _drawable(rivals: Mapping[str, Rival]) -> dict[str, Rival]:
    """Runs with at least two finite samples, and no more than there are line styles."""
    return dict(islice(((name, rival) for name, rival in rivals.items() if _has_samples(rival.run)), len(LOOKS)))


def _has_samples(run: Run) -> bool:
    if run.log is None:
        return False
    samples = np.concatenate([np.asarray(part) for part in (run.log.e, run.log.de, run.log.tau)], axis=1)
    return int(np.isfinite(samples).all(axis=1).sum()) >= 2


def _pictures(rivals: Mapping[str, Rival], rows: list[Row], folder: Path) -> list[Picture]:
    drawn = _drawable(rivals)
    if not drawn:
        return []
    runs = {name: rival.run for name, rival in drawn.items()}
    paths = {name: tip_paths(rival.scenario.plant.robot, rival.run) for name, rival in drawn.items()}
    desired = max((goal for _, goal in paths.values()), key=len)
    enveloped = [name for name, run in runs.items() if run.has_envelope]
    behind = f" Behind them lies the envelope of {enveloped[0]}." if len(enveloped) == 1 else ""
    specs = [
        (
            "tracking-errors",
            "Tracking errors",
            "At the beginning, and their absolute values over the run, each the largest sample of a short interval."
            + behind,
            figures.compared_errors(runs),
        ),
        (
            "velocity-errors",
            "Velocity errors",
            "At the beginning, and their absolute values over the run, drawn in the same way.",
            figures.compared_velocity_errors(runs),
        ),
        (
            "torques",
            "Torques",
            "Over the whole run, and at the beginning. A tinted band is the range of a chattering torque; "
            "peaks far above all others are cut off.",
            figures.compared_torques(runs, limits=torque_limits(next(iter(drawn.values())).scenario)),
        ),
        (
            "tip-paths",
            "Paths of the tip",
            "Over the desired path; each starts at a ring.",
            figures.compared_tip_paths({name: path for name, (path, _) in paths.items()}, desired),
        ),
    ]
    for metric, group in groupby((row for row in rows if row.metric.bars), key=lambda row: row.metric):
        metric_rows = list(group)
        bars = {name: [row.values[name] for row in metric_rows] for name in drawn}
        units = ", ".join(dict.fromkeys(row.unit for row in metric_rows))
        joints = short_names([row.joint for row in metric_rows])
        caption = f"{metric.meaning}, joint by joint on a logarithmic axis."
        figure = figures.metric_bars(bars, f"{metric.title}  [{units}]", joints)
        specs.append((metric.key, metric.title.capitalize(), caption, figure))
    return [picture(figure, folder, name, title, caption) for name, title, caption, figure in specs]
