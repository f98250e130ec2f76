"""A scenario's law as a program for a Universal Robots arm."""

from __future__ import annotations

from functools import partial

from ..onboard.write import RobotTarget, export_robot
from .program import run_ur

UNIVERSAL_ROBOTS = RobotTarget(
    name="a Universal Robots arm",
    joints=6,
    period=2e-3,
    lost=10,  # the robot leaves torque control as soon as commands stop
    folder="ur",
    files={"README.md.j2": "README.md"},
    program=run_ur,
)

export_ur = partial(export_robot, UNIVERSAL_ROBOTS)
"""Write a program for ur_rtde, and the law that it runs: see `export_robot`."""
