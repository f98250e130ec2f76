"""Read an arm from an MJCF file, MuJoCo's own format."""

from __future__ import annotations

import dataclasses
import math
import re
import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from slidax.core.errors import DefinitionError, locate_errors, nearest_word
from slidax.core.joint_names import quote_names

from ..articulated import Articulated
from ..assemble import assemble
from ..joint import Joint
from .inertias import Inertias, RigidInertias
from .mjcf_checks import check_compiled, check_motion, check_spec, drop_weightless_shapes, leave_out_objects, name_all
from .reading import Notes, matrix_of, mujoco, reading, turn_about
from .source import RobotFile, elements, owner_at, read_robot_file, require_named_files


def actuators_of_joint(model: Any, joint: int) -> list[int]:
    """Return the indices of the actuators that drive a joint of a MuJoCo model, by the joint's index."""
    kinds = mujoco().mjtTrn
    direct = (int(kinds.mjTRN_JOINT), int(kinds.mjTRN_JOINTINPARENT))
    return [i for i in range(model.nu) if model.actuator_trntype[i] in direct and model.actuator_trnid[i, 0] == joint]


def torque_limits(model: Any) -> np.ndarray:
    """Return the torque limit of each joint of a MuJoCo model, N m or N; infinite if the file has none.

    Each limit holds in both directions.

    Raises DefinitionError, naming the joint, if its torque range does not contain both directions.
    """
    limits = []
    for joint in range(model.njnt):
        lower, upper = _actuator_range(model, joint)
        if model.jnt_actfrclimited[joint]:
            low, high = (float(end) for end in model.jnt_actfrcrange[joint])
            lower, upper = max(lower, low), min(upper, high)
        if not lower < 0.0 < upper:
            raise DefinitionError(
                f"the torque of joint `{model.joint(joint).name}` must act in both directions; its range is "
                f"{lower:g} to {upper:g}"
            )
        limits.append(min(-lower, upper))
    return np.array(limits)


def _actuator_range(model: Any, joint: int) -> tuple[float, float]:
    """Return the sum of the torque ranges of a joint's actuators; infinite without actuators."""
    ranges = [_torque_range(model, actuator) for actuator in actuators_of_joint(model, joint)]
    if not ranges:
        return -math.inf, math.inf
    return sum(low for low, _ in ranges), sum(high for _, high in ranges)


def _torque_range(model: Any, actuator: int) -> tuple[float, float]:
    library, gear = mujoco(), float(model.actuator_gear[actuator, 0])
    low, high = -math.inf, math.inf
    if model.actuator_forcelimited[actuator]:
        low, high = (float(end) for end in model.actuator_forcerange[actuator])
    motor = (
        model.actuator_gaintype[actuator] == int(library.mjtGain.mjGAIN_FIXED)
        and model.actuator_biastype[actuator] == int(library.mjtBias.mjBIAS_NONE)
        and model.actuator_dyntype[actuator] == int(library.mjtDyn.mjDYN_NONE)
    )
    if motor and model.actuator_ctrllimited[actuator]:
        gain = float(model.actuator_gainprm[actuator, 0])
        ends = sorted(gain * float(end) for end in model.actuator_ctrlrange[actuator])
        low, high = max(low, ends[0]), min(high, ends[1])
    if gear == 0.0:
        return 0.0, 0.0
    first, last = sorted((gear * low, gear * high))
    return first, last


HINGE = 3
"""MuJoCo's number for a hinge joint; the other joints of an arm are slide joints."""


def joints_of(model: Any, tip: str | None) -> list[Joint]:
    """Convert the bodies of a MuJoCo model to links, and return them with their joints.

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
    # Position of the last hinge in the body's frame; all joints of a body are defined in this frame.
    anchor = np.zeros(3)
    chain: list[Joint] = []
    first = int(model.body_jntadr[body])
    for joint in range(first, first + int(model.body_jntnum[body])):
        axis, reference = np.array(model.jnt_axis[joint]), float(model.qpos0[model.jnt_qposadr[joint]])
        revolute = model.jnt_type[joint] == HINGE
        here = np.array(model.jnt_pos[joint]) if revolute else anchor
        moved = model.joint(joint).name
        back = turn_about(axis, -reference) if revolute else np.eye(3)
        offset = here - anchor if revolute else -reference * axis
        chain.append(
            Joint(
                name=moved,
                kind="revolute" if revolute else "prismatic",
                parent=chain[-1].name if chain else parent,
                link=f"{name}/{moved}",
                rotation=rotation @ back,
                translation=translation + rotation @ offset,
                axis=axis,
                torque=float(torques[joint]),
                **_motion_parameters(model, joint),
            )
        )
        anchor, rotation, translation = here, np.eye(3), np.zeros(3)
    if chain and not anchor.any():
        chain[-1] = dataclasses.replace(chain[-1], link=name, **_inertial(model, body))
        return chain
    # The last joint's frame is at its hinge, the body's frame elsewhere.
    body_joint = Joint(
        name=f"{name}, fixed",
        kind="fixed",
        parent=chain[-1].name if chain else parent,
        link=name,
        rotation=rotation,
        translation=translation - rotation @ anchor,
        **_inertial(model, body),
    )
    return [*chain, body_joint]


def _inertial(model: Any, body: int) -> dict[str, Any]:
    """Return mass, centre and inertia of a body; empty for a body fixed to the world, whose mass has no effect."""
    if model.body_weldid[body] == 0:
        return {}
    turned = matrix_of(model.body_iquat[body])
    return {
        "mass": float(model.body_mass[body]),
        "center": np.array(model.body_ipos[body]),
        "inertia": turned @ np.diag(model.body_inertia[body]) @ turned.T,
    }


def _motion_parameters(model: Any, joint: int) -> dict[str, Any]:
    """Return limits, friction and rotor inertia of a joint, including those of its actuators."""
    dof = int(model.jnt_dofadr[joint])
    actuators = actuators_of_joint(model, joint)
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


def from_mjcf(
    source: str | Path,
    *,
    tip: str | None = None,
    locked: Mapping[str, float] | None = None,
    gravity: Sequence[float] | None = None,
    meshes: bool = False,
    inertias: Inertias = "given",
) -> Articulated:
    """Read an arm from an MJCF file, by MuJoCo (`pip install 'slidax[robots]'`).

    Positions are MuJoCo's and include `ref`. Damping is viscous friction, `frictionloss` is Coulomb friction. Torque
    limits come from `actuatorfrcrange` and from the joints' actuators; for an asymmetric range the smaller side counts.
    MJCF has no velocity limits, so they are infinite. Contacts are ignored. Objects of a scene that are not fixed to
    the arm, such as a box on a table, are dropped with a DefinitionWarning. Other forces on the joints are errors:
    springs, tendons, equalities, compensated gravity.

    - `source`: path of the file, or its text.
    - `tip`: name of the body or site whose frame is the tip; optional if only one moving body carries no other body.
    - `locked`: positions of joints that do not move, such as a gripper's, rad or m.
    - `gravity`: acceleration in the world's frame [3], m/s²; by default the file's.
    - `meshes`: True if every mesh must exist. Only meshes that define a body's inertia are read.
    - `inertias`: treatment of an inertia that no rigid body can have, such as one with a principal moment greater than
      the sum of the others. "given" replaces it by the nearest possible one if no principal moment is negative and none
      changes by more than 1 % of the largest, and is an error otherwise; "nearest" replaces it always, "strict" never.
      A DefinitionWarning states the size of a replacement.

    Raises DefinitionError, naming the element, if the file is not one arm on a fixed base, or has a feature that such
    an arm cannot have.
    """
    file = read_robot_file(source, "mujoco", "from_urdf reads <robot>")
    notes = Notes()
    with locate_errors(str(file.path or "")):
        held = dict(locked or {})
        feasible = RigidInertias(inertias)
        _refuse_nan(file.root)
        with reading() as messages:
            spec = _spec(file)
            # MuJoCo would otherwise fuse bodies that are fixed to each other, and lose their names.
            spec.compiler.fusestatic = False
            name_all(spec)
            objects = leave_out_objects(spec, tip)
            check_spec(spec)
            attached = file.root.find(".//attach") is not None
            drop_weightless_shapes(spec, file.folder, meshes, attached)
            feasible.of_bodies(spec)
            model = spec.compile()
            if any("NaN" in line for line in messages):
                raise DefinitionError("an included file has a number that is NaN")
            check_compiled(model, held)
            joints = joints_of(model, tip)
            check_motion(model, joints, held)
            end = tip if tip is not None else _only_leaf(model)
            _check_tip(model, joints, end)
            down = _gravity(model) if gravity is None else gravity
        name = file.root.get("model") or "robot"
        arm = assemble(joints, tip=end, locked=held, gravity=down, name=name)
    for line in messages:
        notes.add(f"MuJoCo says: {line}")
    feasible.add_to(notes)
    if objects:
        notes.add(f"{quote_names(objects)} {'is' if len(objects) == 1 else 'are'} no part of the arm and left out")
    notes.warn(str(file.path or name), 2)
    return arm


def _spec(file: RobotFile) -> Any:
    has_parts = any(file.root.find(f".//{tag}") is not None for tag in ("include", "model"))
    try:
        require_named_files(file.root, file.folder)
        if file.path is not None and has_parts:
            return mujoco().MjSpec.from_file(str(file.path))
        # MuJoCo reads only files in UTF-8 whose names end with .xml.
        spec = mujoco().MjSpec.from_string(file.text)
        spec.modelfiledir = f"{file.folder}/"
        return spec
    except ValueError as error:
        # The error has only a line number, and with included files does not say in which file.
        line = re.search(r"Element '(\w+)', line (\d+)", str(error))
        if line is None or has_parts:
            raise
        owner = owner_at(file.text, line[1], int(line[2]))
        raise ValueError(f"{error} in {owner}" if owner else str(error)) from error


def _refuse_nan(root: ET.Element) -> None:
    """Reject NaN, which MuJoCo reads as a missing number."""
    for where, element in elements(root):
        for name, text in element.attrib.items():
            if name not in ("name", "file", "content") and "nan" in text.lower().split():
                raise DefinitionError(f"{name} in <{element.tag}> of {where} is NaN: `{text}`")


def _only_leaf(model: Any) -> str:
    carrying = set(model.body_parentid[1:].tolist())
    moving = [i for i in range(1, model.nbody) if model.body_weldid[i] != 0]
    leaves = [model.body(i).name for i in moving if i not in carrying]
    if not leaves:
        raise DefinitionError("the file has no joint that moves a body")
    if len(leaves) > 1:
        raise DefinitionError(f"the tip is ambiguous: give tip=NAME; {', '.join(leaves)} carry no other body")
    return str(leaves[0])


def _check_tip(model: Any, joints: Sequence[Joint], tip: str) -> None:
    if tip not in {joint.link for joint in joints}:
        known = [model.body(i).name for i in range(1, model.nbody)] + [model.site(i).name for i in range(model.nsite)]
        raise DefinitionError(f"`tip` names `{tip}`, which is neither a body nor a site; {nearest_word(tip, known)}")


def _gravity(model: Any) -> list[float]:
    off = model.opt.disableflags & int(mujoco().mjtDisableBit.mjDSBL_GRAVITY)
    return [0.0, 0.0, 0.0] if off else [float(g) for g in model.opt.gravity]
