"""Arms from third-party URDF files in example-robot-data."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import pytest

from slidax.arms import Articulated, from_urdf

cmeel = pytest.importorskip("cmeel", reason="the robot files come with example-robot-data")
FOLDER = Path(cmeel.__path__[0]).parent / "cmeel.prefix" / "share" / "example-robot-data" / "robots"


@dataclass(frozen=True)
class Arm:
    """A file in the folder of example-robot-data, and how it is read."""

    file: str
    tip: str
    locked: dict[str, float] = field(default_factory=dict)
    limits: bool = True
    """False if the file has impossible limits."""

    @property
    def path(self) -> str:
        return str(FOLDER / self.file)

    @property
    def name(self) -> str:
        return self.file.split("/")[-1]

    def read(self) -> Articulated:
        return from_urdf(self.path, tip=self.tip, locked=self.locked, limits=self.limits)


FINGERS = {"panda_finger_joint1": 0.02, "panda_finger_joint2": 0.03}
ARMS = [
    Arm("panda_description/urdf/panda.urdf", "panda_hand_tcp", FINGERS),
    Arm("panda_description/urdf/panda_collision.urdf", "panda_hand_tcp", FINGERS),
    Arm("xarm_description/urdf/xarm7.urdf", "link7"),
    Arm("z1_description/urdf/z1.urdf", "gripperStator", {"jointGripper": -0.5}),
    Arm("ur_description/urdf/ur3_robot.urdf", "tool0"),
    Arm("ur_description/urdf/ur5_robot.urdf", "tool0"),
    Arm("ur_description/urdf/ur5_gripper.urdf", "ee_link"),
    Arm("ur_description/urdf/ur10_robot.urdf", "tool0"),
    Arm("kinova_description/robots/kinova.urdf", "j2s6s200_end_effector"),
    Arm("so_arm_description/urdf/so100.urdf", "jaw"),
    Arm("asr_twodof_description/urdf/TwoDofs.urdf", "Tip"),
    Arm("double_pendulum_description/urdf/double_pendulum_simple.urdf", "link3", limits=False),
]
WALKER = Arm("laikago_description/urdf/laikago.urdf", "RL_foot")
"""Four legs: a tree with branches, hung up by its trunk."""
