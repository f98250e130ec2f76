"""Joints and links of a compiled MuJoCo model."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from ..joint import Joint
from .mjcf_torques import geared, torque_limits
from .rotation import matrix_of, turn_about

HINGE = 3
"""MuJoCo's number of a joint that turns; the other kind that an arm has slides."""


def joints_of(model: Any, tip: str | None) -> list[Joint]:
    """Return the bodies as links, with their joints.

    A body may have several joints at different points. Each gets a massless link of its own that carries the next
    joint, and the last link carries the body.

    - `tip`: name of the tip; a site with this name becomes a link too.
    """
    torques = torque_limits(model)
    carrying: list[str | None] = [None]
    joints: list[Joint] = []
    for i in range(1, model.nbody):
        chain = _chain(model, i, carrying[model.body_parentid[i]], torques)
        joints.extend(chain)
        carrying.append(chain[-1].name)
    bodies = {joint.link for joint in joints}
    for i in range(model.nsite):
        if model.site(i).name == tip and tip not in bodies:
            joints.append(_site(model, i, carrying[model.site_bodyid[i]]))
    return joints


def _chain(model: Any, body: int, parent: str | None, torques: np.ndarray) -> list[Joint]:
    name = model.body(body).name
    rotation, translation = matrix_of(model.body_quat[body]), np.array(model.body_pos[body])
    # The place in the body about which it turned last; a body's joints all stand in its own axes.
    anchor = np.zeros(3)
    chain: list[Joint] = []
    first = int(model.body_jntadr[body])
    for joint in range(first, first + int(model.body_jntnum[body])):
        axis, reference = np.array(model.jnt_axis[joint]), float(model.qpos0[model.jnt_qposadr[joint]])
        turns = model.jnt_type[joint] == HINGE
        here = np.array(model.jnt_pos[joint]) if turns else anchor
        moved = model.joint(joint).name
        back = turn_about(axis, -reference) if turns else np.eye(3)
        offset = here - anchor if turns else -reference * axis
        chain.append(
            Joint(
                name=moved,
                kind="revolute" if turns else "prismatic",
                parent=chain[-1].name if chain else parent,
                link=f"{name}/{moved}",
                rotation=rotation @ back,
                translation=translation + rotation @ offset,
                axis=axis,
                torque=float(torques[joint]),
                **_motion(model, joint),
            )
        )
        anchor, rotation, translation = here, np.eye(3), np.zeros(3)
    if chain and not anchor.any():
        chain[-1] = dataclasses.replace(chain[-1], link=name, **_weight(model, body))
        return chain
    # The last joint's frame stands where it turns, and the body's somewhere else.
    behind = Joint(
        name=f"{name}, fixed",
        kind="fixed",
        parent=chain[-1].name if chain else parent,
        link=name,
        rotation=rotation,
        translation=translation - rotation @ anchor,
        **_weight(model, body),
    )
    return [*chain, behind]


def _weight(model: Any, body: int) -> dict[str, Any]:
    """Mass, centre and inertia of a body; nothing for one fixed to the world, which may have any."""
    if model.body_weldid[body] == 0:
        return {}
    turned = matrix_of(model.body_iquat[body])
    return {
        "mass": float(model.body_mass[body]),
        "center": np.array(model.body_ipos[body]),
        "inertia": turned @ np.diag(model.body_inertia[body]) @ turned.T,
    }


def _motion(model: Any, joint: int) -> dict[str, Any]:
    """Limits, friction and rotor inertia of a joint, including those of its actuators."""
    dof = int(model.jnt_dofadr[joint])
    actuators = geared(model, joint)
    squares = model.actuator_gear[actuators, 0] ** 2
    values = {
        "armature": float(model.dof_armature[dof] + np.dot(squares, model.actuator_armature[actuators])),
        "viscous": float(model.dof_damping[dof] + np.dot(squares, model.actuator_damping[actuators])),
        "coulomb": float(model.dof_frictionloss[dof]),
    }
    if model.jnt_limited[joint]:
        lower, upper = (float(end) for end in model.jnt_range[joint])
        values |= {"lower": lower, "upper": upper}
    return values


def _site(model: Any, site: int, parent: str | None) -> Joint:
    return Joint(
        name=f"{model.site(site).name}, site",
        kind="fixed",
        parent=parent,
        link=model.site(site).name,
        rotation=matrix_of(model.site_quat[site]),
        translation=np.array(model.site_pos[site]),
    )
