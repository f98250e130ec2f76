"""The playground: three arms, each under our law, the law as printed, and three rivals with the same estimator."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from slidax.scenarios import ScenarioDescription
from slidax.scenarios.load import described, validated

from .beside import PRINTED, settings_of
from .playground import playground
from .setting import Choice

TITLE = "slidax playground"

PERIODS = Choice("simulation.period", "sampling period", "s", (0.0005, 0.001, 0.002))
DELAYS = Choice("sensor.delay", "age of a measurement when it arrives", "periods", (0.0, 1.0))
ENCODERS = Choice("sensor.resolution", "resolution of the encoders", "rad", (0.0, 1e-5))
COARSER = Choice("sensor.resolution", "resolution of the encoders", "rad", (1e-5, 5e-5))
SLOWER = Choice("simulation.period", "sampling period", "s", (0.001, 0.002))


@dataclass(frozen=True)
class Shown:
    """An arm of the playground.

    - `scenario`: built in.
    - `arm`, `title`: its label and its title.
    - `changes`: changes that do not alter the run, but make friction or rotor inertia tunable.
    - `gains`: of the rivals, the best of the grids of `scripts/figures/panda.py` on this very run.
    - `choices`: values that need programs of their own.
    """

    scenario: str
    arm: str
    title: str
    changes: dict[str, Any]
    gains: dict[str, dict[str, float]]
    choices: tuple[Choice, ...]

    @property
    def description(self) -> ScenarioDescription:
        """The scenario, with a friction term where the arm itself has none."""
        description = described(self.scenario)
        changes = dict(self.changes)
        if not changes:
            terms = [term.model_dump(exclude_unset=True) for term in description.disturbance.terms]
            changes["disturbance.terms"] = [*terms, {"kind": "friction", "coulomb": 0.0, "viscous": 0.0}]
        return validated(description.model_dump(exclude_unset=True), changes)


ARMS = (
    Shown(
        "example-4.1-1khz",
        "two_link",
        "Two-link arm",
        {},
        {
            "computed_torque": {"kp": 3200.0, "kd": 320.0},
            "slotine_li": {"rate": 80.0, "damping": 40.0, "gain": 20.0, "layer": 0.05},
            "super_twisting": {"rate": 80.0, "k1": 30.0, "k2": 100.0},
        },
        (PERIODS, DELAYS, ENCODERS),
    ),
    Shown(
        "example-4.2-1khz",
        "scara",
        "SCARA arm",
        {},
        {
            "computed_torque": {"kp": 500.0, "kd": 80.0},
            "slotine_li": {"rate": 80.0, "damping": 2.5, "gain": 2.5, "layer": 0.05},
            "super_twisting": {"rate": 80.0, "k1": 30.0, "k2": 1.0},
        },
        (PERIODS, DELAYS, ENCODERS),
    ),
    Shown(
        "panda-payload",
        "panda",
        "Franka Panda",
        {"robot.plant.armature": 0.1},
        {
            "computed_torque": {"kp": 600.0, "kd": 240.0},
            "slotine_li": {"rate": 80.0, "damping": 2.5, "gain": 20.0, "layer": 0.1},
            "super_twisting": {"rate": 80.0, "k1": 20.0, "k2": 300.0},
        },
        (SLOWER, DELAYS, COARSER),
    ),
)
"""In the order of display."""


def built_in() -> dict[str, Any]:
    """The manifest of the playground."""
    settings = [
        setting
        for shown in ARMS
        for setting in settings_of(shown.description, shown.arm, [PRINTED, *shown.gains], shown.gains, shown.choices)
    ]
    return playground(TITLE, settings, {shown.arm: shown.title for shown in ARMS})
