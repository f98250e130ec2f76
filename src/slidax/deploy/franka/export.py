"""A scenario's law as a program for a Franka arm."""

from __future__ import annotations

from functools import partial

from ..onboard.write import RobotTarget, export_robot
from .program import run_franka

FRANKA = RobotTarget(
    name="a Franka arm",
    joints=7,
    period=1e-3,
    lost=20,  # the robot's own rule
    folder="franka",
    files={"main.cpp.j2": "main.cpp", "CMakeLists.txt.j2": "CMakeLists.txt", "README.md.j2": "README.md"},
    program=run_franka,
)

export_franka = partial(export_robot, FRANKA)
"""Write programs for libfranka (C++) and pylibfranka (Python), and the law that both run: see `export_robot`."""
