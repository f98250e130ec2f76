"""Pinocchio models of described joints; Pinocchio keeps joint axes and fuses fixed links by itself."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from slidax.arms import Joint
from tests.peers.by_pinocchio import held, pinocchio

KINDS = {
    "revolute": pinocchio.JointModelRevoluteUnaligned,
    "prismatic": pinocchio.JointModelPrismaticUnaligned,
    "fixed": pinocchio.JointModelRevoluteUnaligned,
}


def for_pinocchio(joints: Sequence[Joint], locked: Mapping[str, float]) -> Any:
    """Pinocchio's model; the tip can be any link."""
    model = pinocchio.Model()
    for joint in joints:
        axis = np.array([1.0, 0.0, 0.0]) if joint.kind == "fixed" else joint.axis / np.linalg.norm(joint.axis)
        parent = 0 if joint.parent is None else model.getJointId(joint.parent)
        place = pinocchio.SE3(joint.rotation, joint.translation)
        number = model.addJoint(parent, KINDS[joint.kind](axis), place, joint.name)
        frame = model.addJointFrame(number)
        body = pinocchio.Inertia(joint.mass, joint.center, joint.inertia)
        model.appendBodyToJoint(number, body, pinocchio.SE3.Identity())
        model.armature[-1] = joint.armature
        model.addFrame(pinocchio.Frame(joint.link, number, frame, pinocchio.SE3.Identity(), pinocchio.BODY))
    return held(model, {joint.name: 0.0 for joint in joints if joint.kind == "fixed"} | dict(locked))
