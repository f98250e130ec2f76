"""Wrong rotors in both payload scenarios: with learning, without it, and harder cases."""

from __future__ import annotations

from typing import Any

from sampled_data_figures.loops import small, table, write_table

from .runs import ARMS, CORNERS, NOMINAL, OFF, TRUE, outside, run, steady_error, steady_step, worst

HARDER: list[tuple[str, str, dict[str, Any]]] = [
    *((name, f"delay of {delay} periods", {"sensor.delay": delay}) for name in ARMS for delay in (2, 3)),
    *((name, f"encoders of {step:g} rad", {"sensor.resolution": step}) for name in ARMS for step in (1e-4, 2.5e-4)),
    *((name, f"payload of {mass:g} kg", {"robot.plant.load.mass": mass}) for name in ARMS for mass in (1.0, 4.0)),
    *((name, "no payload", {"robot.plant.load": None}) for name in ARMS),
    *((name, "as it is", {}) for name in ("panda-table", "panda-pick", "panda-drop")),
]
BEYOND = (0.005, 0.5, 1.0)


def make() -> None:
    """Simulates all of them, and writes the tables of docs/learning.md."""
    _cells()
    rows = []
    for name in ARMS:
        for true in BEYOND:
            runs = [run(name, nominal, true) for nominal in NOMINAL]
            rows.append([name, f"true rotors of {true:g}, the four nominal ones", *_row(runs)])
    for name, what, changes in HARDER:
        rows.append([name, what, *_row([run(name, *corner, changes) for corner in CORNERS])])
    head = ["scenario", "case", "samples outside", "largest steady error [rad]", "largest step [N m]"]
    write_table("learning.md", "harder", table(head, rows))


def _row(runs: list[Any]) -> list[str]:
    count, error, step = worst(runs)
    return [f"{count}", small(error), f"{step:.2g}"]


def _cells() -> None:
    rows = []
    for name in ARMS:
        for true in TRUE:
            known = run(name, true, true, OFF)
            for nominal in NOMINAL:
                without, learns = run(name, nominal, true, OFF), run(name, nominal, true)
                rows.append(
                    [
                        name.removesuffix("-payload"),
                        f"{nominal:g}",
                        f"{true:g}",
                        f"{outside(without)}",
                        f"{outside(learns)}",
                        small(steady_error(known)),
                        small(steady_error(learns)),
                        f"{steady_step(learns):.2f}",
                    ]
                )
    head = [
        "arm",
        "nominal",
        "true [kg m²]",
        "outside, nothing learnt",
        "outside, learning",
        "error of the known arm [rad]",
        "error, learning [rad]",
        "step, learning [N m]",
    ]
    write_table("learning.md", "cells", table(head, rows))
