"""The page of a scenario's certificates."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from slidax import figures
from slidax.certificates.envelope import envelope_of
from slidax.metrics import short_names
from slidax.scenarios import Scenario
from slidax.scenarios.written import as_yaml

from .page import write_page
from .picture import Picture, picture

if TYPE_CHECKING:
    from slidax.certificates import Certificates


def write_certificate_report(
    scenario: Scenario, certificates: Certificates, out: Path, *, seconds: float, command: str = ""
) -> Path:
    """Write `report.html`, `figures/*.svg` and `certificate.json` to the folder `out`, and return the page's path.

    - `scenario`, `certificates`: a scenario with its certificates.
    - `seconds`, `command`: computing time and command line, for the page.
    """
    return write_page(
        out,
        "certificate.html.j2",
        data={"certificate.json": certificates.as_json()},
        scenario=scenario,
        certificates=certificates,
        pictures=_certificate_pictures(scenario, certificates, out / "figures"),
        parameters={"The scenario": as_yaml(scenario.description)},
        seconds=seconds,
        command=command,
    )


def _certificate_pictures(scenario: Scenario, certificates: Certificates, folder: Path) -> list[Picture]:
    t = np.linspace(0.0, scenario.t1, 801)
    envelope = envelope_of(scenario, t)
    if envelope is None:
        return []
    plant = scenario.plant
    robot = getattr(plant, "own", plant).robot
    radii = np.sort(np.abs(np.stack(envelope)), axis=0)
    bounds = _bounds(certificates, scenario.t1)
    caption = "The two sides of the envelope by their distance from zero"
    caption += ", and the bounds of |e| with their grades." if bounds else "; there is no bound of the error."
    figure = figures.bounded_error(t, radii, bounds, short_names(robot.joint_names), robot.joint_units)
    return [picture(figure, folder, "bounded-error", "Bound of the error", caption)]


def _bounds(certificates: Certificates, t1: float) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Bounds of |e| over time, of certificates that hold."""
    bounds: dict[str, tuple[np.ndarray, np.ndarray]] = {}
    for verdict in certificates:
        if not verdict.holds:
            continue
        bound: Any = verdict.bound
        if "error_over_time" in bound:
            bounds[f"at this rate, grade {verdict.grade}"] = (
                np.asarray(bound["times"], float),
                np.asarray(bound["error_over_time"], float),
            )
        elif verdict.name == "ultimate_bound":
            error = np.asarray(bound["error"], float)
            bounds[f"in the end, grade {verdict.grade}"] = np.array([0.75 * t1, t1]), np.stack([error, error])
    return bounds
