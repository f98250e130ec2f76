"""Checks of MuJoCo models: reject features that an arm of rigid links cannot have, leave out other objects."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from slidax.core.errors import DefinitionError, nearest_word

from ..joint import Joint
from .reading import WITHOUT, mujoco, require_mesh

MOST_BODIES = 1000


def name_all(spec: Any) -> None:
    """Give each unnamed body and joint of a MuJoCo `MjSpec` a name, so that messages can name it."""
    taken = {element.name for kind in (spec.bodies, spec.joints, spec.sites) for element in kind}
    for kind, elements in (("body", spec.bodies), ("joint", spec.joints)):
        for number, element in enumerate(elements):
            name = element.name or f"{kind} {number}"
            while not element.name and name in taken:
                name += "'"
            element.name = name
            taken.add(name)


def check_spec(spec: Any) -> None:
    """Reject features of an `MjSpec` that MuJoCo drops at compilation, or rejects without naming them.

    Raises DefinitionError naming joint or body.
    """
    library = mujoco()
    if len(spec.bodies) == 1:
        raise DefinitionError("the file has no body, and so no joint that moves one")
    if len(spec.bodies) > MOST_BODIES:
        raise DefinitionError(f"the file has {len(spec.bodies)} bodies; at most {MOST_BODIES} are read: remove objects")
    for joint in spec.joints:
        if joint.type in (library.mjtJoint.mjJNT_FREE, library.mjtJoint.mjJNT_BALL):
            kind = "free" if joint.type == library.mjtJoint.mjJNT_FREE else "a ball joint"
            raise DefinitionError(
                f"joint `{joint.name}` of body `{joint.parent.name}` is {kind}; an arm stands on a fixed base and has "
                f"only hinge and slide joints: remove this joint from the file, which fixes the body, or name as `tip` "
                f"the end of another arm in it"
            )
        lower, upper = (float(end) for end in joint.range)
        if joint.limited != library.mjtLimited.mjLIMITED_FALSE and (lower, upper) != (0.0, 0.0) and not lower < upper:
            raise DefinitionError(f"range of joint `{joint.name}` must be lower < upper; got {lower:g} and {upper:g}")


def check_compiled(model: Any, locked: Mapping[str, float]) -> None:
    """Reject features of a compiled MuJoCo model that an arm of rigid links cannot have.

    They are numbers that are not finite, negative damping or friction, drag, joint springs, non-linear damping, ties
    between moving joints (equalities, tendons), and `gravcomp`.

    - `locked`: positions of the joints that the reader fixes, by name, rad or m. They may have springs and ties.

    Raises DefinitionError naming the element.
    """
    free = {j for j in range(model.njnt) if model.joint(j).name not in locked}
    names = [model.joint(j).name for j in range(model.njnt)]
    for name in locked:
        if name not in names:
            raise DefinitionError(f"`locked` names joint `{name}`, which does not exist; {nearest_word(name, names)}")
    _check_finite(model)
    _check_options(model)
    _check_joints(model, free)
    _check_equalities(model, free)
    _check_tendons(model, free)
    for body in range(1, model.nbody):
        if model.body_gravcomp[body] and _carrier(model, body, free):
            raise DefinitionError(
                f"body `{model.body(body).name}` has gravcomp, which cancels its weight; remove it, and compensate "
                f"gravity in the law"
            )


def _check_finite(model: Any) -> None:
    for kind, count in (("body", model.nbody), ("joint", model.njnt), ("site", model.nsite)):
        prefix = "jnt" if kind == "joint" else kind
        for field in ("pos", "quat", "ipos", "iquat", "mass", "inertia", "axis", "range", "actfrcrange"):
            values = getattr(model, f"{prefix}_{field}", None)
            if values is None or count == 0:
                continue
            finite = np.isfinite(np.reshape(values, (count, -1))).all(axis=1)
            if not finite.all():
                name = getattr(model, kind)(int(np.argmin(finite))).name
                raise DefinitionError(f"{field} of {kind} `{name}` must be finite")
    for field in ("gear", "forcerange", "ctrlrange", "gainprm", "armature", "damping"):
        values = getattr(model, f"actuator_{field}")
        # Squares must be finite, too, since gears are squared.
        with np.errstate(over="ignore"):
            squares = np.square(np.reshape(values, (model.nu, values.size // max(model.nu, 1))))
        finite = np.isfinite(squares).all(axis=1)
        if not finite.all():
            wrong = model.actuator(int(np.argmin(finite)))
            name = wrong.name or f"number {wrong.id + 1}"
            raise DefinitionError(f"{field} of actuator `{name}` and its square must be finite")
    for field in ("armature", "damping", "frictionloss"):
        values = getattr(model, f"dof_{field}")
        wrong = ~np.isfinite(values) | (values < 0)
        if wrong.any():
            dof = int(np.argmax(wrong))
            name = model.joint(int(model.dof_jntid[dof])).name
            raise DefinitionError(f"{field} of joint `{name}` must be >= 0 and finite; got {values[dof]:g}")


def _check_options(model: Any) -> None:
    bits = mujoco().mjtDisableBit
    if model.opt.density or model.opt.viscosity:
        raise DefinitionError(
            f"the option density {model.opt.density:g} or viscosity {model.opt.viscosity:g} causes drag, which "
            f"slidax does not model; remove it"
        )
    for flag, values in (("damper", model.dof_damping), ("frictionloss", model.dof_frictionloss)):
        off = int(bits.mjDSBL_DAMPER if flag == "damper" else bits.mjDSBL_FRICTIONLOSS | bits.mjDSBL_CONSTRAINT)
        if model.opt.disableflags & off and np.any(values):
            joint = model.joint(int(model.dof_jntid[int(np.argmax(values != 0))])).name
            raise DefinitionError(
                f"the flag {flag} is off, but joint `{joint}` has this force; remove the flag or the force"
            )


def _check_joints(model: Any, free: set[int]) -> None:
    for joint in sorted(free):
        name = model.joint(joint).name
        if model.jnt_stiffness[joint] or np.any(model.jnt_stiffnesspoly[joint]):
            raise DefinitionError(f"joint `{name}` has stiffness, a spring, which slidax does not model; remove it")
        if np.any(model.dof_dampingpoly[model.jnt_dofadr[joint]]):
            raise DefinitionError(f"the damping of joint `{name}` is not linear in the velocity; give one number")


def _check_equalities(model: Any, free: set[int]) -> None:
    bits, kinds = mujoco().mjtDisableBit, mujoco().mjtEq
    if model.opt.disableflags & int(bits.mjDSBL_EQUALITY | bits.mjDSBL_CONSTRAINT):
        return
    for i in range(model.neq):
        kind, ends = model.eq_type[i], [int(model.eq_obj1id[i]), int(model.eq_obj2id[i])]
        name = model.eq(i).name or f"number {i + 1}"
        if not model.eq_active0[i]:
            continue
        if kind == int(kinds.mjEQ_JOINT):
            held = not free & set(ends)
            between = [model.joint(end).name for end in ends if end >= 0]
        elif kind in (int(kinds.mjEQ_CONNECT), int(kinds.mjEQ_WELD)):
            sites = model.eq_objtype[i] == int(mujoco().mjtObj.mjOBJ_SITE)
            bodies = [int(model.site_bodyid[end]) if sites else end for end in ends]
            held = _carrier(model, bodies[0], free) == _carrier(model, bodies[1], free)
            between = [model.body(body).name for body in bodies]
        elif kind == int(kinds.mjEQ_TENDON):
            held = not any(_is_moved(model, end, free) for end in ends if end >= 0)
            between = [model.tendon(end).name for end in ends if end >= 0]
        else:
            held, between = False, []
        if not held:
            raise DefinitionError(
                f"the equality `{name}` ties {' and '.join(f'`{end}`' for end in between) or 'bodies'}; from_mjcf "
                f"reads no closed loops and no coupled joints: lock the joints, or remove it"
            )


def _check_tendons(model: Any, free: set[int]) -> None:
    for i in range(model.ntendon):
        forces = {
            "stiffness": [model.tendon_stiffness[i], *np.ravel(model.tendon_stiffnesspoly[i])],
            "damping": [model.tendon_damping[i], *np.ravel(model.tendon_dampingpoly[i])],
            "frictionloss": [model.tendon_frictionloss[i]],
            "armature": [model.tendon_armature[i]],
            "a limited range": [model.tendon_limited[i]],
        }
        for what, values in forces.items():
            if np.any(values) and _is_moved(model, i, free):
                name = model.tendon(i).name or i + 1
                raise DefinitionError(
                    f"tendon `{name}` has {what}; slidax models no tendons: remove it, or lock its joints if it is a "
                    "fixed tendon"
                )


def _is_moved(model: Any, tendon: int, free: set[int]) -> bool:
    """True if a moving joint changes a tendon's length; always True for a spatial tendon."""
    first = int(model.tendon_adr[tendon])
    for k in range(first, first + int(model.tendon_num[tendon])):
        if model.wrap_type[k] != int(mujoco().mjtWrap.mjWRAP_JOINT) or int(model.wrap_objid[k]) in free:
            return True
    return False


def _carrier(model: Any, body: int, free: set[int]) -> int:
    """Return the index of the first body with a moving joint, from this body towards the base; 0 if there is none."""
    while body:
        first = int(model.body_jntadr[body])
        if free & set(range(first, first + int(model.body_jntnum[body]))):
            return body
        body = int(model.body_parentid[body])
    return 0


POSTURES = 3
"""Number of random postures in which the forces and inertias are tested."""

ROUNDING = 1e-9
"""Largest passive force that counts as 0, relative to 1 N m or N plus the largest passive force of a joint."""

SINGULAR = 1e-12
"""Least eigenvalue of a regular inertia matrix, relative to its largest."""


def check_motion(model: Any, joints: Sequence[Joint], locked: Mapping[str, float]) -> None:
    """Reject forces other than viscous friction on a joint, and joints that move without inertia.

    Such forces come from plugins, flexible bodies and other features of MuJoCo that `check_compiled` does not name.

    - `model`: compiled MuJoCo model.
    - `joints`: its joints, from `joints_of`.
    - `locked`: positions of joints that do not move, by name.

    Raises DefinitionError naming the joint.
    """
    library, data = mujoco(), mujoco().MjData(model)
    numbers = np.random.default_rng(0)
    # Every joint has one coordinate, so its index is the same among positions and velocities.
    indices = {model.joint(i).name: int(model.jnt_qposadr[i]) for i in range(model.njnt)}
    moving = [joint for joint in joints if joint.kind != "fixed" and joint.name not in locked]
    at = [indices[joint.name] for joint in moving]
    viscous = np.array([joint.viscous for joint in moving])
    if not moving:
        return
    for _ in range(POSTURES):
        for name, position in locked.items():
            data.qpos[indices[name]] = position
        data.qpos[at] = [np.clip(numbers.uniform(-1.0, 1.0), joint.lower, joint.upper) for joint in moving]
        data.qvel[at] = numbers.uniform(-1.0, 1.0, len(at))
        library.mj_fwdPosition(model, data)
        library.mj_fwdVelocity(model, data)
        _check_inertia(library, model, data, moving, at)
        rest = data.qfrc_passive[at] + viscous * data.qvel[at]
        worst = int(np.argmax(np.abs(rest)))
        if abs(rest[worst]) > ROUNDING * (1.0 + np.abs(data.qfrc_passive[at]).max()):
            raise DefinitionError(
                f"joint `{moving[worst].name}`, which moves `{moving[worst].link}`, has a passive force other than "
                f"damping, {rest[worst]:.3g} in one posture, by MuJoCo; slidax models none: remove its cause"
            )


def _check_inertia(library: Any, model: Any, data: Any, moving: Sequence[Joint], at: list[int]) -> None:
    full = np.zeros((model.nv, model.nv))
    library.mj_fullM(model, data, full)
    values, vectors = np.linalg.eigh(full[np.ix_(at, at)])
    if values[0] <= SINGULAR * values[-1]:
        still = np.abs(vectors[:, 0])
        which = ", ".join(f"`{joint.name}`" for joint, v in zip(moving, still, strict=True) if v > 0.1 * still.max())
        raise DefinitionError(f"the joints {which} can move without inertia; do two of them turn about one axis?")


WEIGHS = "the body's inertia comes from it, so give the body an <inertial>"


def drop_weightless_shapes(spec: Any, folder: Path, meshes: bool, attached: bool) -> None:
    """Replace meshes and height fields that define no body's inertia by a small ball.

    Their files may then be missing. Skins, materials and textures are deleted.

    - `folder`: folder of the robot file.
    - `meshes`: True if the replaced meshes' files must exist, too.
    - `attached`: True if parts come from other files. Meshes are then not checked: only MuJoCo knows their folders.

    Raises DefinitionError, naming the body, if a mesh that must exist is missing.
    """
    files = {mesh.name: mesh for mesh in spec.meshes}
    needed: set[str] = set()
    for body in spec.bodies:
        weighs = body is not spec.worldbody and has_inertia_from_shapes(body)
        for geom in body.geoms:
            mesh = files.get(geom.meshname)
            if mesh is not None and mesh.file and (weighs or meshes) and not attached:
                file = Path(mesh.file).name if spec.strippath else mesh.file
                at = folder / mesh.compiler.meshdir
                require_mesh(f"body `{body.name}`", file, at, instead=WEIGHS if weighs else WITHOUT)
            if weighs:
                needed.add(geom.meshname)
            elif geom.meshname or geom.hfieldname:
                _make_ball(geom)
            geom.material = ""
        for site in body.sites:
            site.material = ""
    for tendon in spec.tendons:
        tendon.material = ""
    unused = [mesh for mesh in spec.meshes if mesh.name not in needed]
    for element in (*unused, *spec.skins, *spec.materials, *spec.textures, *spec.hfields):
        spec.delete(element)


def has_inertia_from_shapes(body: Any) -> bool:
    """True if MuJoCo computes a body's inertia from its shapes."""
    kinds = mujoco().mjtInertiaFromGeom
    setting = body.compiler.inertiafromgeom
    if setting == kinds.mjINERTIAFROMGEOM_AUTO:
        return not body.explicitinertial
    return bool(setting == kinds.mjINERTIAFROMGEOM_TRUE)


def _make_ball(geom: Any) -> None:
    geom.type, geom.size = mujoco().mjtGeom.mjGEOM_SPHERE, [1e-3, 1e-3, 1e-3]
    geom.meshname, geom.hfieldname = "", ""


def leave_out_objects(spec: Any, tip: str | None) -> list[str]:
    """Delete objects of a scene, such as a box on a table, from an `MjSpec`, and return the names of their root bodies.

    Each child of the world body is the root of a tree. If the tip is known, an object is a moving tree without it.
    Otherwise an object is a tree with a free or a ball joint, if another moving tree has neither. A tree in an active
    equality constraint is not an object.

    - `tip`: name of the body or site at the arm's end; None if unknown.
    """
    trees = [body for body in spec.bodies if body.parent is not None and body.parent.name == spec.worldbody.name]
    moving = {tree.name: kinds for tree in trees if (kinds := _kinds(tree))}
    arms = [name for name, kinds in moving.items() if not kinds & _loose()]
    if tip is None:
        objects = [name for name in moving if name not in arms] if arms else []
    else:
        holding = [tree.name for tree in trees if tip in _names(tree)]
        objects = [name for name in moving if name not in holding] if holding and holding[0] in moving else []
    tied = {name for equality in spec.equalities if equality.active for name in (equality.name1, equality.name2)}
    objects = [tree.name for tree in trees if tree.name in objects and not tied & _names(tree)]
    for tree in trees:
        if tree.name in objects:
            spec.delete(tree)
    return objects


def _loose() -> set[Any]:
    return {mujoco().mjtJoint.mjJNT_FREE, mujoco().mjtJoint.mjJNT_BALL}


def _bodies(tree: Any) -> list[Any]:
    return [tree, *tree.find_all("body")]


def _kinds(tree: Any) -> set[Any]:
    """Kinds of joints in a tree."""
    return {joint.type for body in _bodies(tree) for joint in body.joints}


def _names(tree: Any) -> set[str]:
    """Names of a tree's bodies, sites and joints."""
    return {element.name for body in _bodies(tree) for element in (body, *body.sites, *body.joints)}
