"""The page of a loop that is linearised."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from slidax import figures
from slidax._writing import write_text
from slidax.metrics import short_names
from slidax.scenarios import Scenario
from slidax.scenarios.written import as_yaml

from .machine import machine, versions
from .page import render
from .picture import Picture, picture

if TYPE_CHECKING:
    from slidax.linear import Linear

PLACES = {"torque": "broken at the torque, between law and drives", "measurement": "broken at the measured positions"}


def write_linear_report(scenario: Scenario, found: Linear, out: Path, *, seconds: float, command: str = "") -> Path:
    """Writes `out/report.html`, `out/figures/*.svg` and `out/linear.json`, and returns the page's path.

    - `scenario`: the closed loop.
    - `found`: what it is near a point.
    - `out`: a folder, made if missing.
    - `seconds`: that it took.
    - `command`: the command that did it, for the page.
    """
    out.mkdir(parents=True, exist_ok=True)
    opened = found.held and found.stable
    values: dict[str, Any] = {
        "scenario": scenario,
        "found": found,
        "margins": {where: found.margins(where) for where in PLACES} if opened else {},
        "together": {where: found.together(where) for where in PLACES} if opened else {},
        "places": PLACES,
        "joints": short_names(found.joint_names),
        "pictures": _pictures(found, out / "figures") if opened else [],
        "parameters": as_yaml(scenario.description),
        "versions": versions(),
        "machine": machine(),
        "seconds": seconds,
        "command": command,
    }
    text = json.dumps(found.as_json(), indent=2, allow_nan=False, ensure_ascii=False)
    write_text(out / "linear.json", text)
    page = out / "report.html"
    write_text(page, render("linear.html.j2", values))
    return page


def _pictures(found: Linear, folder: Path) -> list[Picture]:
    # At half of the sampling frequency itself L may be 0.
    omega = np.geomspace(1e-4, 0.99, 800) * np.pi / found.system.period
    names = short_names(found.joint_names)
    made = []
    for where, title in PLACES.items():
        around = found.closed(where).response(omega)
        loops = {}
        for k, name in enumerate(names):
            one = around[:, k, k]
            loops[name] = -one / (1.0 + one)
        caption = "What goes around each joint's loop, the others closed, up to half of the sampling frequency."
        made.append(picture(figures.bode(omega, loops, title), folder, f"bode-{where}", f"Bode, {where}", caption))
        disks = {one.where: one.disk for one in found.margins(where) or []}
        caption = "The same in the complex plane; the circle is the disk margin of the joint that comes nearest to -1."
        drawn = figures.nyquist(loops, disks, title)
        made.append(picture(drawn, folder, f"nyquist-{where}", f"Nyquist, {where}", caption))
    return made
