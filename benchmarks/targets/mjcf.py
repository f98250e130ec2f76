"""An arm of ours as an MJCF file, for simulators of other people."""

from __future__ import annotations

import mujoco
import numpy as np

from slidax.arms import Articulated


def mjcf(arm: Articulated) -> str:
    """The arm's joints, links and friction, without shapes; what it carries is a body at its tip.

    - `arm`: all numbers are its own.
    """
    lines = [f'<mujoco model="{arm.name}">', '  <compiler angle="radian" boundmass="1e-9" boundinertia="1e-9"/>']
    lines.append("  <worldbody>")
    children = {i: [k for k, parent in enumerate(arm.parents) if parent == i] for i in range(-1, arm.joints)}

    def link(i: int, depth: int) -> None:
        indent = "  " * depth
        place = _placed(arm.translations[i], arm.rotations[i])
        lines.append(f'{indent}<body name="{arm.link_names[i]}" {place}>')
        lines.append(f"{indent}  {_inertial(arm.masses[i], arm.centers[i], arm.inertias[i])}")
        kind = "hinge" if arm.joint_units[i] == "rad" else "slide"
        lines.append(
            f'{indent}  <joint name="{arm.joint_names[i]}" type="{kind}" axis="0 0 1" armature="{arm.armature[i]}" '
            f'damping="{arm.viscous[i]}" frictionloss="{arm.coulomb[i]}"/>'
        )
        if i == arm.tip_joint and float(arm.payload.mass) > 0:
            inertial = _inertial(arm.payload.mass, arm.payload.center, arm.payload.inertia)
            lines.append(
                f'{indent}  <body name="carried" {_placed(arm.tip_translation, arm.tip_rotation)}>{inertial}</body>'
            )
        for child in children[i]:
            link(child, depth + 1)
        lines.append(f"{indent}</body>")

    for first in children[-1]:
        link(first, 2)
    return "\n".join([*lines, "  </worldbody>", "</mujoco>", ""])


def _placed(translation: object, rotation: object) -> str:
    quaternion = np.zeros(4)
    mujoco.mju_mat2Quat(quaternion, np.asarray(rotation, float).ravel())
    return f'pos="{_row(translation)}" quat="{_row(quaternion)}"'


def _inertial(mass: object, center: object, inertia: object) -> str:
    moments = np.asarray(inertia, float)
    full = [moments[i, j] for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))]
    return f'<inertial mass="{float(np.asarray(mass))!r}" pos="{_row(center)}" fullinertia="{_row(full)}"/>'


def _row(values: object) -> str:
    return " ".join(repr(float(value)) for value in np.asarray(values, float).ravel())
