"""The page of a certificate."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from slidax import figures
from slidax._writing import write_text
from slidax.certificates.envelope import envelope_of
from slidax.metrics import short_names
from slidax.scenarios import Scenario
from slidax.scenarios.written import as_yaml

from .machine import machine, versions
from .page import render
from .picture import Picture, picture

if TYPE_CHECKING:
    from slidax.certificates import Certificates


def write_certificate_report(
    scenario: Scenario, found: Certificates, out: Path, *, seconds: float, command: str = ""
) -> Path:
    """Writes `out/report.html`, `out/figures/*.svg` and `out/certificate.json`, and returns the page's path.

    - `scenario`: what was asked about.
    - `found`: its certificates.
    - `out`: a folder, made if missing.
    - `seconds`: that it took.
    - `command`: the command that did it, for the page.
    """
    out.mkdir(parents=True, exist_ok=True)
    values = {
        "scenario": scenario,
        "found": found,
        "pictures": _pictures(scenario, found, out / "figures"),
        "parameters": as_yaml(scenario.description),
        "versions": versions(),
        "machine": machine(),
        "seconds": seconds,
        "command": command,
    }
    text = json.dumps(found.as_json(), indent=2, allow_nan=False, ensure_ascii=False)
    write_text(out / "certificate.json", text)
    page = out / "report.html"
    write_text(page, render("certificate.html.j2", values))
    return page


def _pictures(scenario: Scenario, found: Certificates, folder: Path) -> list[Picture]:
    t = np.linspace(0.0, scenario.t1, 801)
    envelope = envelope_of(scenario, t)
    if envelope is None:
        return []
    plant = scenario.plant
    robot = getattr(plant, "own", plant).robot
    radii = np.sort(np.abs(np.stack(envelope)), axis=0)
    bounds = _bounds(found, scenario.t1)
    caption = "The two sides of the envelope by their distance from zero"
    caption += ", and the bounds of |e| with their grades." if bounds else "; there is no bound of the error."
    drawn = figures.bounded_error(t, radii, bounds, short_names(robot.joint_names), robot.joint_units)
    return [picture(drawn, folder, "bounded-error", "Bound of the error", caption)]


def _bounds(found: Certificates, t1: float) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Bounds of |e| over time, of certificates that hold."""
    bounds: dict[str, tuple[np.ndarray, np.ndarray]] = {}
    for one in found:
        if not one.holds:
            continue
        given: Any = one.bound
        if "error_over_time" in given:
            bounds[f"at this rate, grade {one.grade}"] = (
                np.asarray(given["times"], float),
                np.asarray(given["error_over_time"], float),
            )
        elif one.name == "ultimate_bound":
            error = np.asarray(given["error"], float)
            bounds[f"in the end, grade {one.grade}"] = np.array([0.75 * t1, t1]), np.stack([error, error])
    return bounds
