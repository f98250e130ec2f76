"""Check, by MuJoCo, that a model moves as its joints and links state."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from slidax._errors import DefinitionError

from ..joint import Joint
from .loader import mujoco

POSTURES = 3
ROUNDING = 1e-9
SINGULAR = 1e-12
"""Least eigenvalue of the inertia matrix, of its largest."""


def check_motion(model: Any, joints: Sequence[Joint], locked: Mapping[str, float]) -> None:
    """Reject forces other than viscous friction on a joint, and joints that move without inertia.

    Such forces come from plugins, flexible bodies and other features of MuJoCo that `check_compiled` does not name.

    Raises DefinitionError naming the joint.
    """
    library, data = mujoco(), mujoco().MjData(model)
    numbers = np.random.default_rng(0)
    # Every joint is of one number, so that its places among positions and velocities are the same.
    places = {model.joint(i).name: int(model.jnt_qposadr[i]) for i in range(model.njnt)}
    moving = [joint for joint in joints if joint.kind != "fixed" and joint.name not in locked]
    at = [places[joint.name] for joint in moving]
    viscous = np.array([joint.viscous for joint in moving])
    if not moving:
        return
    for _ in range(POSTURES):
        for name, position in locked.items():
            data.qpos[places[name]] = position
        data.qpos[at] = [np.clip(numbers.uniform(-1.0, 1.0), joint.lower, joint.upper) for joint in moving]
        data.qvel[at] = numbers.uniform(-1.0, 1.0, len(at))
        library.mj_fwdPosition(model, data)
        library.mj_fwdVelocity(model, data)
        _check_inertia(library, model, data, moving, at)
        rest = data.qfrc_passive[at] + viscous * data.qvel[at]
        worst = int(np.argmax(np.abs(rest)))
        if abs(rest[worst]) > ROUNDING * (1.0 + np.abs(data.qfrc_passive[at]).max()):
            raise DefinitionError(
                f"on joint `{moving[worst].name}`, which moves `{moving[worst].link}`, acts a force besides damping, "
                f"{rest[worst]:.3g} in one posture, by MuJoCo; an arm here has none, so remove what makes it"
            )


def _check_inertia(library: Any, model: Any, data: Any, moving: Sequence[Joint], at: list[int]) -> None:
    full = np.zeros((model.nv, model.nv))
    library.mj_fullM(model, data, full)
    values, vectors = np.linalg.eigh(full[np.ix_(at, at)])
    if values[0] <= SINGULAR * values[-1]:
        still = np.abs(vectors[:, 0])
        which = ", ".join(f"`{joint.name}`" for joint, v in zip(moving, still, strict=True) if v > 0.1 * still.max())
        raise DefinitionError(f"the joints {which} can move without inertia; do two of them turn about one axis?")
