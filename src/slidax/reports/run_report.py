"""The report of a single run."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from slidax import figures, metrics
from slidax.scenarios import Scenario
from slidax.simulation import Run

from .machine import machine, versions
from .page import render
from .parameters import as_yaml
from .picture import Picture, picture
from .tip_paths import tip_paths

PER_JOINT = {
    "steady_error": ("steady error, max |e| over the last quarter", "{0}"),
    "peak_torque": ("peak torque, max |τ|", "{1}"),
    "initial_torque": ("initial torque, |τ(0)|", "{1}"),
    "max_torque_step": ("largest torque step", "{1}"),
    "steady_torque_step": ("largest torque step, last quarter", "{1}"),
    "steady_torque_step_rms": ("torque step, root mean square, last quarter", "{1}"),
    "iae": ("IAE, Σ|e| for t > 2 s", "{0}"),
    "eci": ("ECI, Σ|τ|²", "({1})²"),
    "aice": ("AICE, Σ|Δτ|", "{1}"),
    "envelope_margin": ("least distance to a bound, over the envelope's width", ""),
}
"""What each metric is called, and its unit; {0} is the joint's own, {1} that of its torque."""


def write_run_report(scenario: Scenario, run: Run, out: Path, *, command: str = "") -> Path:
    """Writes `out/report.html` and `out/figures/*.svg`, and returns the path of the page.

    - `scenario`: what was simulated.
    - `run`: what came of it; without a log the page has no figures.
    - `out`: a folder, made if missing.
    - `command`: the command that did it, for the page.
    """
    out.mkdir(parents=True, exist_ok=True)
    summary = metrics.summary(run)
    values = {
        "scenario": scenario,
        "run": run,
        "outcome": run.outcome,
        "rows": _rows(summary, run, scenario.plant.robot.torque_units),
        "violations": summary["envelope_violations"],
        "pictures": _pictures(scenario, run, out / "figures"),
        "parameters": as_yaml(scenario.description),
        "versions": versions(),
        "machine": machine(),
        "command": command,
    }
    page = out / "report.html"
    page.write_text(render("run.html.j2", values), encoding="utf-8")
    return page


def _rows(summary: dict[str, Any], run: Run, torque_units: tuple[str, ...]) -> list[tuple[str, list[str], list[Any]]]:
    """Name, unit per joint and value per joint of each metric."""
    rows: list[tuple[str, list[str], list[Any] | None]] = []
    for band, times in summary["settling_time"].items():
        settled = [None if time >= float(run.t1) else time for time in times]
        rows.append((f"last time with |e| above {band}", ["s"] * run.joints, settled))
    for key, (name, unit) in PER_JOINT.items():
        units = [unit.format(*pair).replace("(N)", "N") for pair in zip(run.joint_units, torque_units, strict=True)]
        rows.append((name, units, summary[key]))
    nothing = [None] * run.joints
    return [(name, units, nothing if values is None else list(values)) for name, units, values in rows]


def _pictures(scenario: Scenario, run: Run, folder: Path) -> list[Picture]:
    if run.log is None or len(np.atleast_1d(run.log.t)) < 2:
        return []
    inside = " in its envelope" if run.has_envelope else ""
    drawn = [
        ("tracking-error", "Tracking error", f"The error{inside}, and its size.", figures.tracking_error(run)),
        ("velocity-error", "Velocity error", "Its beginning, and its size over the run.", figures.velocity_error(run)),
        ("torque", "Torque", "Over the whole run, and at its beginning.", figures.torque(run)),
        ("tip-path", "Path of the tip", "In the workspace.", figures.tip_path(*tip_paths(scenario.plant.robot, run))),
    ]
    return [picture(figure, folder, name, title, caption) for name, title, caption, figure in drawn]
