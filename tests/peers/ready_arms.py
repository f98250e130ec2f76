"""Peer models of the built-in arms, built directly from the numbers in their files without code of slidax."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from ruamel.yaml import YAML
from scipy.spatial.transform import Rotation

from slidax import arms
from tests.peers.by_mujoco import mujoco
from tests.peers.by_pinocchio import pinocchio

FOLDER = Path(arms.__file__).parent / "built_in_arms"
DESCRIPTIONS: dict[str, Any] = {path.stem: YAML(typ="safe", pure=True).load(path) for path in FOLDER.glob("*.yaml")}


def for_pinocchio(name: str) -> Any:
    """Pinocchio's model."""
    description, model = DESCRIPTIONS[name], pinocchio.Model()
    for joint in description["joints"]:
        link = joint["link"]
        parent = 0 if joint["parent"] is None else model.getJointId(joint["parent"])
        kind = pinocchio.JointModelRevoluteUnaligned(np.array(joint["axis"], float))
        number = model.addJoint(parent, kind, _place(joint), joint["name"])
        xx, yy, zz, xy, xz, yz = link["inertia"]
        inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]], float)
        body = pinocchio.Inertia(link["mass"], np.array(link["center"], float), inertia)
        model.appendBodyToJoint(number, body, pinocchio.SE3.Identity())
        model.armature[-1] = joint.get("armature", 0.0)
    tip = description["tip"]
    carrier = model.getJointId(tip["joint"])
    model.addFrame(pinocchio.Frame(tip["name"], carrier, 0, _place(tip), pinocchio.BODY))
    return model


def _place(described: dict[str, Any]) -> Any:
    turned = pinocchio.rpy.rpyToMatrix(*map(float, described["turn"]))
    return pinocchio.SE3(turned, np.array(described["translation"], float))


def for_mujoco(name: str) -> Any:
    """MuJoCo's model."""
    description, spec = DESCRIPTIONS[name], mujoco.MjSpec()
    spec.compiler.degree = False
    bodies = {None: spec.worldbody}
    for joint in description["joints"]:
        link = joint["link"]
        body = bodies[joint["parent"]].add_body(name=link["name"], **_pose(joint))
        body.explicitinertial = True
        body.mass, body.ipos, body.fullinertia = link["mass"], link["center"], link["inertia"]
        hinge = mujoco.mjtJoint.mjJNT_HINGE
        body.add_joint(name=joint["name"], type=hinge, axis=joint["axis"], armature=joint.get("armature", 0.0))
        bodies[joint["name"]] = body
    tip = description["tip"]
    bodies[tip["joint"]].add_body(name=tip["name"], **_pose(tip))
    return spec.compile()


def _pose(described: dict[str, Any]) -> dict[str, Any]:
    turned = Rotation.from_euler("xyz", described["turn"])
    return {"pos": described["translation"], "quat": turned.as_quat(scalar_first=True)}
