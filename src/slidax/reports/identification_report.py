"""The report of an identification."""

from __future__ import annotations

from pathlib import Path

from slidax import figures
from slidax._writing import write_text
from slidax.identification import Identification

from .machine import machine, versions
from .page import render
from .picture import picture


def write_identification_report(found: Identification, out: Path, *, command: str = "") -> Path:
    """Writes `out/report.html` and `out/figures/*.svg`, and returns the path of the page.

    - `found`: the identification.
    - `out`: a folder, made if missing.
    - `command`: the command that did it, for the page.
    """
    out.mkdir(parents=True, exist_ok=True)
    torque = picture(
        figures.identified_torques(found),
        out / "figures",
        "identified-torques",
        "Torques",
        "Measured and predicted, in the filter's band, and their difference. The shaded part was not fitted.",
    )
    rows = [(one, 0.5 * (one.interval()[1] - one.interval()[0])) for one in found.parameters]
    torques = [
        ("measured", found.measured_rms),
        ("error, fitted part", found.fit_rms),
        ("error, held-out part", found.held_out_rms),
    ]
    values = {
        "found": found,
        "rows": rows,
        "torques": torques,
        "pictures": [torque],
        "versions": versions(),
        "machine": machine(),
        "command": command,
    }
    page = out / "report.html"
    write_text(page, render("identification.html.j2", values))
    return page
