"""A scenario's law for arms with CAN motors in MIT mode, such as Damiao motors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from slidax.core.errors import DefinitionError, each_of, nearest_word
from slidax.scenarios.scenario import Scenario

from .c_project import CProject, export_c, write_files
from .guarded_step import own_plant
from .onboard.can_motors import run_can
from .robots import RobotLimits, write_onboard


@dataclass(frozen=True)
class CanMotor:
    """A motor type, with the ranges that its CAN frames encode: ± position [rad], ± speed [rad/s], ± torque [N m]."""

    name: str
    position: float
    speed: float
    torque: float


MOTORS = {
    motor.name: motor
    for motor in (
        CanMotor("DM3507", 12.5, 50.0, 5.0),
        CanMotor("DM4310", 12.5, 30.0, 10.0),
        CanMotor("DM4310_48V", 12.5, 50.0, 10.0),
        CanMotor("DM4340", 12.5, 10.0, 28.0),
        CanMotor("DM6006", 12.5, 45.0, 20.0),
        CanMotor("DM8006", 12.5, 45.0, 40.0),
        CanMotor("DM8009", 12.5, 45.0, 54.0),
        CanMotor("DM10010L", 12.5, 25.0, 200.0),
        CanMotor("DM10010", 12.5, 20.0, 200.0),
    )
}
"""Damiao motors with their default ranges, as in OpenArm's library openarm_can."""


def export_can(
    scenario: Scenario,
    out: Path,
    *,
    motors: Sequence[str],
    name: str | None = None,
    single: bool = False,
    command: str = "",
    golden: bool = True,
) -> CProject:
    """Write a Python program for python-can to `out`, with C code for the CAN frames and the law that it runs.

    - `motors`: motor type of each joint, a name in `MOTORS`.
    - `name`, `single`, `command`: as in `export_c`.
    - `golden`: include the tests and golden samples, which take most of the time.

    Raises DefinitionError if a motor is unknown or missing, a torque limit exceeds a motor's range, a joint is
    prismatic, the loop's delay is less than one period, or the scenario cannot be exported.
    """
    joints = scenario.state0.q.size
    for word in motors:
        if word not in MOTORS:
            raise DefinitionError(f"unknown motor `{word}`; {nearest_word(word, MOTORS)}")
    if len(motors) != joints:
        raise DefinitionError(f"`motors` must have a name for {each_of(joints, 'joint')}; got {len(motors)}")
    chosen = [MOTORS[word] for word in motors]
    _check(scenario, chosen)
    exported = export_c(scenario, out / "law", name=name, single=single, command=command, golden=golden)
    limits = RobotLimits.of(scenario, exported)
    write_onboard(
        exported, limits, out, {"program.py": run_can}, sources=("can",), more={"motors": [*map(asdict, chosen)]}
    )
    write_files(exported, out, {"can/README.md.j2": "README.md"}, o=limits, motors=chosen)
    return exported


def _check(scenario: Scenario, motors: Sequence[CanMotor]) -> None:
    """Raise DefinitionError if the scenario's delay, joints or torque limits do not fit the joints' motors."""
    plant = own_plant(scenario)
    if scenario.description.timing.whole_periods < 1:
        raise DefinitionError(
            "a CAN motor answers a torque with its state, which the law reads one period later: set the sensor's delay "
            "with `--set sensor.delay=1`",
            where="sensor.delay",
        )
    if set(plant.robot.joint_units) != {"rad"}:
        raise DefinitionError("CAN motors drive only revolute joints; the scenario's arm has a prismatic joint")
    torque = np.inf if plant.actuator is None else np.asarray(plant.actuator.limits.torque)
    for k, (limit, motor) in enumerate(zip(np.broadcast_to(torque, len(motors)), motors, strict=True)):
        if not limit <= motor.torque:
            raise DefinitionError(
                f"the torque limit of joint {k + 1} is {limit:g} N m, above the largest torque in a frame "
                f"of {motor.name}, {motor.torque:g} N m: lower `actuator.torque`, or choose another motor"
            )
