"""The report of several schemes on the same task."""

from __future__ import annotations

import json
from collections.abc import Mapping
from itertools import groupby, islice
from pathlib import Path

import numpy as np

from slidax import figures
from slidax._errors import DefinitionError
from slidax.figures.overlay import LOOKS
from slidax.scenarios import Scenario
from slidax.simulation import Run

from .machine import machine, versions
from .page import render
from .parameters import as_yaml
from .picture import Picture, picture
from .standings import Row, results, standings
from .tip_paths import tip_paths

BARS = {"iae": "IAE", "eci": "ECI", "aice": "AICE"}
"""The metrics that are drawn as bars."""

ACROSS = 5
"""How many schemes stand beside each other in a table."""


def write_comparison(scenario_runs: Mapping[str, tuple[Scenario, Run]], out: Path, *, command: str = "") -> Path:
    """Writes `out/report.html`, `out/figures/*.svg` and `out/results.json`, and returns the path of the page.

    - `scenario_runs`: each scheme's scenario and finished run, by name; runs without a log are in the tables only.
    - `out`: a folder, made if missing.
    - `command`: the command that did it, for the page.

    Raises DefinitionError if there are no runs, or not all of them are of the same arm.
    """
    if not scenario_runs:
        raise DefinitionError("there is nothing to compare: give at least one run")
    scenario, first = next(iter(scenario_runs.values()))
    if any(run.joint_units != first.joint_units for _, run in scenario_runs.values()):
        raise DefinitionError("only runs of the same arm can be compared; these have different joints")
    out.mkdir(parents=True, exist_ok=True)
    rows = standings(scenario_runs)
    pictures = _pictures(scenario_runs, rows, out / "figures")
    timings = [run.timing for _, run in scenario_runs.values() if run.timing]
    values = {
        "scenario": scenario,
        "schemes": list(scenario_runs),
        "shares": _shares(list(scenario_runs)),
        "outcomes": {name: run.outcome for name, (_, run) in scenario_runs.items()},
        "ends": {name: _end(run) for name, (_, run) in scenario_runs.items()},
        "violations": {name: _violations(run) for name, (_, run) in scenario_runs.items()},
        "groups": [(name, list(group)) for name, group in groupby(rows, key=lambda row: row.name)],
        "pictures": pictures,
        "undrawn": [name for name in scenario_runs if name not in _drawn(scenario_runs)],
        "parameters": {name: as_yaml(parts.description) for name, (parts, _) in scenario_runs.items()},
        "versions": versions(),
        "machine": machine(),
        "seconds": sum(timing.compile_s + timing.run_s for timing in timings),
        "command": command,
    }
    text = json.dumps(results(scenario_runs), indent=2, allow_nan=False, ensure_ascii=False)
    (out / "results.json").write_text(text + "\n", encoding="utf-8")
    page = out / "report.html"
    page.write_text(render("comparison.html.j2", values), encoding="utf-8")
    return page


def _shares(names: list[str]) -> list[list[str]]:
    """The names in as few tables as fit on paper, none much shorter than the others."""
    tables = -(-len(names) // ACROSS)
    each = -(-len(names) // tables)
    return [names[start : start + each] for start in range(0, len(names), each)]


def _end(run: Run) -> float:
    return max(0, int(run.tally.samples) - 1) * float(run.period)


def _violations(run: Run) -> int | None:
    return int(run.tally.violations) if run.has_envelope else None


def _drawn(scenario_runs: Mapping[str, tuple[Scenario, Run]]) -> dict[str, tuple[Scenario, Run]]:
    """Those with something to draw, and no more than there are looks."""
    return dict(islice(((name, pair) for name, pair in scenario_runs.items() if _has_samples(pair[1])), len(LOOKS)))


def _has_samples(run: Run) -> bool:
    if run.log is None:
        return False
    samples = np.concatenate([np.asarray(part) for part in (run.log.e, run.log.de, run.log.tau)], axis=1)
    return int(np.isfinite(samples).all(axis=1).sum()) >= 2


def _pictures(scenario_runs: Mapping[str, tuple[Scenario, Run]], rows: list[Row], folder: Path) -> list[Picture]:
    drawn = _drawn(scenario_runs)
    if not drawn:
        return []
    runs = {name: run for name, (_, run) in drawn.items()}
    ways = {name: tip_paths(scenario.plant.robot, run) for name, (scenario, run) in drawn.items()}
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
            figures.compared_torques(runs),
        ),
        (
            "tip-paths",
            "Paths of the tip",
            "Over the desired path; each starts at a ring.",
            figures.compared_tip_paths({name: way for name, (way, _) in ways.items()}, desired),
        ),
    ]
    for key, name in BARS.items():
        found = [row for row in rows if row.metric == key]
        bars = {scheme: [_number(row.values[scheme]) for row in found] for scheme in drawn}
        units = ", ".join(dict.fromkeys(row.unit for row in found))
        caption = f"{found[0].name.removeprefix(name + ', ')}, joint by joint on a logarithmic axis."
        made.append((key, name, caption, figures.metric_bars(bars, f"{name}  [{units}]")))
    return [picture(figure, folder, name, title, caption) for name, title, caption, figure in made]


def _number(value: float | None) -> float:
    return float("nan") if value is None else value
