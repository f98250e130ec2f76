"""A scenario's law for arms of CAN motors with MIT mode, as Damiao's have them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from slidax.core.errors import DefinitionError, each_of, nearest_word
from slidax.scenarios.scenario import Scenario

from .c_project import CProject, export_c, write_files
from .onboard.can_motors import run_can
from .robots import RobotLimits, write_onboard


@dataclass(frozen=True)
class CanMotor:
    """Ranges of a motor's frames: positions, rad, velocities, rad/s, and torques, N m, are within ± these."""

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
"""Damiao motors with their default ranges, from OpenArm's openarm_can."""


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
    """Write a Python program for python-can, the frames in C, and the law that it runs.

    - `motors`: motors of the joints, names in `MOTORS`.
    - `name`, `single`, `command`: as in `export_c`.
    - `golden`: include the tests and golden samples, which take most of the time.

    Raises DefinitionError if a joint has no motor or exceeds its ranges, or the scenario cannot be exported.
    """
    joints = scenario.state0.q.size
    for word in motors:
        if word not in MOTORS:
            raise DefinitionError(f"unknown motor `{word}`; {nearest_word(word, MOTORS)}")
    if len(motors) != joints:
        raise DefinitionError(f"`motors` must have a name for {each_of(joints, 'joint')}; got {len(motors)}")
    chosen = [MOTORS[word] for word in motors]
    exported = export_c(scenario, out / "law", name=name, single=single, command=command, golden=golden)
    limits = RobotLimits.of(scenario, exported)
    if exported.delay < 1:
        raise DefinitionError(
            "a motor answers a torque with its state, which the law reads one period later, and the law must account "
            "for it: `--set sensor.delay=1`",
            where="sensor.delay",
        )
    if limits.unit != "rad" or len({joint.q for joint in exported.joints}) > 1:
        raise DefinitionError("a CAN motor turns a joint; the scenario's arm has joints that slide")
    for k, motor in enumerate(chosen):
        if not limits.torque[k] <= motor.torque:
            raise DefinitionError(
                f"the torque limit of joint {k + 1} is {limits.torque[k]:g} N m, and a frame of {motor.name} holds up "
                f"to {motor.torque:g} N m: set `actuator.torque`, or choose another motor"
            )
    write_onboard(
        exported, limits, out, {"program.py": run_can}, sources=("can",), more={"motors": [*map(asdict, chosen)]}
    )
    write_files(exported, out, {"can/README.md.j2": "README.md"}, o=limits, motors=chosen)
    return exported
