"""The page of one run."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from slidax import figures
from slidax.metrics import Metric, envelope_violations, metrics_of, tool_error, tool_turn
from slidax.scenarios import Scenario
from slidax.simulation import Run

from .page import write_page
from .parameters import parameters
from .picture import Picture, picture
from .tip_paths import tip_paths
from .torque_limits import torque_limits


def write_run_report(
    scenario: Scenario, run: Run, out: Path, *, also: Sequence[Metric[Any]] = (), command: str = ""
) -> Path:
    """Write `report.html` and `figures/*.svg` to the folder `out`, and return the page's path.

    - `scenario`, `run`: a scenario with its run; without a log the page has no figures.
    - `also`: further metrics, such as those of a paper; listed for scenarios from their source.
    - `command`: command line, for the page.
    """
    metrics = [m for m in (*metrics_of(run), *also) if m.per_joint and m.source in scenario.description.source]
    return write_page(
        out,
        "run.html.j2",
        scenario=scenario,
        run=run,
        outcome=run.outcome,
        rows=[(metric, metric.units(run), metric.shown(run)) for metric in metrics],
        violations=envelope_violations(run),
        tool=tool_error(run),
        turn=tool_turn(run),
        pictures=_run_pictures(scenario, run, out / "figures"),
        parameters=parameters(scenario),
        seconds=run.timing.compile_s + run.timing.run_s if run.timing else 0.0,
        command=command,
    )


def _run_pictures(scenario: Scenario, run: Run, folder: Path) -> list[Picture]:
    if run.log is None or len(np.atleast_1d(run.log.t)) < 2:
        return []
    inside = " in its envelope" if run.has_envelope else ""
    torque = figures.torque(run, limits=torque_limits(scenario))
    specs = [
        (
            "tracking-error",
            "Tracking error",
            f"The error{inside}, and its absolute value.",
            figures.tracking_error(run),
        ),
        (
            "velocity-error",
            "Velocity error",
            "Its beginning, and its size over the run.",
            figures.velocity_error(run),
        ),
        ("torque", "Torque", "Over the whole run, and at its beginning.", torque),
        ("tip-path", "Path of the tip", "In the workspace.", figures.tip_path(*tip_paths(scenario.plant.robot, run))),
    ]
    return [picture(figure, folder, name, title, caption) for name, title, caption, figure in specs]
