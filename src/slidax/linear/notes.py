"""Notes on a linearised loop: frozen and non-smooth parts."""

from __future__ import annotations

import numpy as np

from slidax.controllers import SampledData
from slidax.robots import Articulated
from slidax.simulation.loop import Carry, Loop

SLOW = 5.0
"""Times v_s: below this velocity the Coulomb friction of a joint acts as damping."""


def said_of(loop: Loop, carry: Carry, *, rough: bool) -> list[str]:
    """Notes on frozen parts and on points where the loop is not smooth, one sentence each.

    - `carry`: what it has at the time.
    - `rough`: whether derivative and differences disagree.
    """
    notes = []
    law = loop.controller
    if isinstance(law, SampledData) and law.adaptation is not None:
        notes.append("learning: rotors and friction stay as they are believed to be at that time")
    if rough:
        notes.append(
            "not smooth: within a millionth the loop bends so much that derivative and differences disagree; a gate, a "
            "limit or a sign is near, and what is said of stability holds for smaller motions still"
        )
    robot = loop.plant.robot
    if isinstance(robot, Articulated):
        slow = (np.asarray(robot.coulomb) > 0) & (np.abs(carry.state.dq) < SLOW * np.asarray(robot.smoothing))
        if slow.any():
            joints = ", ".join(name for name, applies in zip(robot.joint_names, slow, strict=True) if applies)
            notes.append(
                f"Coulomb friction of {joints} counts as damping, f_c/v_s at rest: that holds for velocities below "
                f"{float(robot.smoothing):g} rad/s alone"
            )
    drive = loop.plant.actuator
    if drive is not None and carry.actuator is not None:
        last = np.asarray(carry.actuator.commands[0])
        limit = np.broadcast_to(np.asarray(drive.limits.torque), last.shape)
        full = np.abs(last) >= limit * (1 - 1e-9)
        if full.any():
            joints = ", ".join(name for name, applies in zip(robot.joint_names, full, strict=True) if applies)
            notes.append(f"{joints} is at its limit of torque: there its loop is open")
    return notes
