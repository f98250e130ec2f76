"""Limits of a robot, and largest errors of a first motion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from slidax.codegen.c import Dialect
from slidax.robots import Articulated, Coupled
from slidax.scenarios import Scenario

from ..contents import Project
from .gravity import own_plant
from .reasons import REASONS

MARGIN = {"rad": 0.03, "m": 0.005}
"""Distance kept from the end of a joint's range."""

ERRORS = {"rad": (0.02, 0.05, 0.1), "m": (0.005, 0.01, 0.02)}
"""Largest errors while the arm holds, while the motion is small, and later."""

HOLDING = 0.1
"""Share of a joint's largest torque that it may take to hold a posture whose weight the robot carries."""

SPEED = 0.95
"""Share of a joint's largest speed that is used."""


@dataclass(frozen=True)
class Allowed:
    """Data for the templates in addition to the project.

    - `unit`, `torque_unit`: of the first joint.
    - `lower`, `upper`, `speed`, `torque`, `rate`: the robot's limits, one number per joint.
    - `torque_hold`: largest torques while it holds, per joint; infinite where the law carries the weight.
    - `error_hold`, `error_small`, `error_full`: largest errors, per joint.
    - `held`, `lost`, `outside`, `limited`, `void`: longest duration of each condition, in periods.
    - `age`: of a measurement when it arrives [s].
    - `carried`: True if the robot carries its own weight.
    """

    unit: str
    torque_unit: str
    lower: list[float]
    upper: list[float]
    speed: list[float]
    torque: list[float]
    rate: list[float]
    torque_hold: list[float]
    error_hold: list[float]
    error_small: list[float]
    error_full: list[float]
    dialect: Dialect
    held: int
    lost: int
    outside: int
    limited: int
    void: int
    age: float
    carried: bool

    reasons = REASONS

    @classmethod
    def of(cls, scenario: Scenario, project: Project, *, lost: int = 20, carried: bool = False) -> Allowed:
        """Limits of the scenario's arm and drives.

        - `lost`: periods without a sample that end a motion.
        - `carried`: True if the robot carries its own weight.
        """
        plant = own_plant(scenario)
        n = len(project.joints)
        endless = np.full(n, np.inf)
        units = plant.robot.joint_units
        margin = np.array([MARGIN[unit] for unit in units])
        errors = np.array([ERRORS[unit] for unit in units]).T.tolist()
        lower, upper, speed, hold = -endless, endless, endless, endless
        if isinstance(plant.robot, Articulated | Coupled):
            sheet = plant.robot.limits
            lower, upper = np.asarray(sheet.lower) + margin, np.asarray(sheet.upper) - margin
            speed = SPEED * np.asarray(sheet.velocity)
            hold = HOLDING * np.asarray(sheet.torque) if carried else endless
        torque, rate = endless, endless
        if plant.actuator is not None:
            torque = np.broadcast_to(np.asarray(plant.actuator.limits.torque), (n,))
            rate = np.broadcast_to(np.asarray(plant.actuator.limits.rate), (n,))
        return cls(
            unit=units[0],
            torque_unit=plant.robot.torque_units[0],
            lower=_numbers(lower),
            upper=_numbers(upper),
            speed=_numbers(speed),
            torque=_numbers(torque),
            rate=_numbers(rate),
            torque_hold=_numbers(hold),
            error_hold=errors[0],
            error_small=errors[1],
            error_full=errors[2],
            dialect=project.dialect,
            held=5,
            lost=lost,
            outside=_periods(0.1, project.period),
            limited=_periods(0.25, project.period),
            void=_periods(0.1, project.period),
            age=float(scenario.description.sensor.delay) * project.period,
            carried=carried,
        )

    def literal(self, number: float) -> str:
        """A number in C."""
        return self.dialect.number(number, "f64")

    def shown(self, numbers: Sequence[float]) -> str:
        """Numbers in a comment, once if they are the same."""
        texts = ["none" if np.isinf(number) else f"{number:g}" for number in numbers]
        return texts[0] if len(set(texts)) == 1 else ", ".join(texts)

    def __getitem__(self, name: str) -> list[float]:
        return getattr(self, name)


def _numbers(values: np.ndarray) -> list[float]:
    # A few digits are enough for a limit, and are easier to read.
    return [float(f"{value:.6g}") for value in np.asarray(values, float).tolist()]


def _periods(seconds: float, period: float) -> int:
    return max(round(seconds / period), 1)
