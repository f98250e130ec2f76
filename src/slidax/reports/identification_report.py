"""The page of an identification."""

from __future__ import annotations

from pathlib import Path

from slidax import figures
from slidax.identification import Identification

from .page import write_page
from .picture import picture


def write_identification_report(identification: Identification, out: Path, *, command: str = "") -> Path:
    """Write `report.html` and `figures/*.svg` for an `identification` to the folder `out`; return the page's path.

    - `command`: command line, for the page.
    """
    torque = picture(
        figures.identified_torques(identification),
        out / "figures",
        "identified-torques",
        "Torques",
        "Measured and predicted torques in the filter's band, and their difference. The shaded part was held out.",
    )
    intervals = [parameter.interval() for parameter in identification.parameters]
    return write_page(
        out,
        "identification.html.j2",
        identification=identification,
        rows=[
            (parameter, 0.5 * (interval[1] - interval[0]))
            for parameter, interval in zip(identification.parameters, intervals, strict=True)
        ],
        torques=[
            ("measured", identification.measured_rms),
            ("error, fitted part", identification.fit_rms),
            ("error, held-out part", identification.held_out_rms),
        ],
        pictures=[torque],
        parameters={},
        seconds=identification.seconds,
        command=command,
    )
