"""The page of a linearised loop."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from slidax import figures
from slidax.metrics import short_names
from slidax.scenarios import Scenario
from slidax.scenarios.written import as_yaml

from .page import write_page
from .picture import Picture, picture

if TYPE_CHECKING:
    from slidax.linear import Linear

PLACES = {"torque": "broken at the torque, between law and drives", "measurement": "broken at the measured positions"}


def write_linear_report(scenario: Scenario, linear: Linear, out: Path, *, seconds: float, command: str = "") -> Path:
    """Write `report.html`, `figures/*.svg` and `linear.json` to the folder `out`, and return the page's path.

    - `scenario`, `linear`: the closed loop, and its linearisation.
    - `seconds`, `command`: computing time and command line, for the page.
    """
    has_margins = linear.held and linear.stable
    return write_page(
        out,
        "linear.html.j2",
        data={"linear.json": linear.as_json()},
        scenario=scenario,
        linear=linear,
        margins={where: linear.margins(where) for where in PLACES} if has_margins else {},
        together={where: linear.together(where) for where in PLACES} if has_margins else {},
        places=PLACES,
        joints=short_names(linear.joint_names),
        pictures=_loop_pictures(linear, out / "figures") if has_margins else [],
        parameters={"The scenario": as_yaml(scenario.description)},
        seconds=seconds,
        command=command,
    )


def _loop_pictures(linear: Linear, folder: Path) -> list[Picture]:
    # At half of the sampling frequency itself L may be 0.
    omega = np.geomspace(1e-4, 0.99, 800) * np.pi / linear.system.period
    names = short_names(linear.joint_names)
    pictures = []
    for where, title in PLACES.items():
        closed = linear.closed(where).response(omega)
        loops = {name: -closed[:, k, k] / (1.0 + closed[:, k, k]) for k, name in enumerate(names)}
        caption = "Open loop of each joint with the other joints closed, up to half of the sampling frequency."
        figure = figures.bode(omega, loops, title)
        pictures.append(picture(figure, folder, f"bode-{where}", f"Bode, {where}", caption))
        disks = {margin.where: margin.disk for margin in linear.margins(where) or []}
        caption = "The same loops in the complex plane; the circle is the disk margin of the joint nearest to -1."
        figure = figures.nyquist(loops, disks, title)
        pictures.append(picture(figure, folder, f"nyquist-{where}", f"Nyquist, {where}", caption))
    return pictures
