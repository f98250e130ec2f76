"""The playground: three arms, each under our law, the law as printed, and three rivals with the same estimator."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from slidax.scenarios.load import described

from .beside import PRINTED, settings_of
from .playground import playground
from .setting import Choice

TITLE = "slidax playground"

PERIODS = Choice("simulation.period", "sampling period", "s", (0.0005, 0.001, 0.002, 0.004))
DELAYS = Choice("sensor.delay", "age of a measurement when it arrives", "periods", (0.0, 1.0, 2.0))


@dataclass(frozen=True)
class Shown:
    """An arm of the playground.

    - `scenario`: built in.
    - `arm`, `title`: its label and its title.
    - `gains`: of the rivals, the best of the grids of `scripts/robot_figures/tuned.py` on this very run.
    - `choices`: what has several programs.
    """

    scenario: str
    arm: str
    title: str
    gains: dict[str, dict[str, float]]
    choices: tuple[Choice, ...]


ARMS = (
    Shown(
        "example-4.1-1khz",
        "two_link",
        "Two-link arm",
        {
            "computed_torque": {"kp": 3200.0, "kd": 320.0},
            "slotine_li": {"rate": 80.0, "damping": 40.0, "gain": 20.0, "layer": 0.05},
            "super_twisting": {"rate": 80.0, "k1": 30.0, "k2": 100.0},
        },
        (PERIODS, DELAYS),
    ),
    Shown(
        "example-4.2-1khz",
        "scara",
        "SCARA arm",
        {
            "computed_torque": {"kp": 500.0, "kd": 80.0},
            "slotine_li": {"rate": 80.0, "damping": 2.5, "gain": 2.5, "layer": 0.05},
            "super_twisting": {"rate": 80.0, "k1": 30.0, "k2": 1.0},
        },
        (PERIODS, DELAYS),
    ),
    Shown(
        "panda-payload",
        "panda",
        "Franka Panda",
        {
            "computed_torque": {"kp": 600.0, "kd": 240.0},
            "slotine_li": {"rate": 80.0, "damping": 2.5, "gain": 20.0, "layer": 0.1},
            "super_twisting": {"rate": 80.0, "k1": 20.0, "k2": 300.0},
        },
        (),
    ),
)
"""In the order in which they are shown."""


def built_in() -> dict[str, Any]:
    """The manifest of the playground."""
    settings = [
        setting
        for shown in ARMS
        for setting in settings_of(
            described(shown.scenario), shown.arm, [PRINTED, *shown.gains], shown.gains, shown.choices
        )
    ]
    return playground(TITLE, settings, {shown.arm: shown.title for shown in ARMS})
