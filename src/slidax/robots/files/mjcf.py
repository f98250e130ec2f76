"""An arm from an MJCF file, MuJoCo's own format."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from slidax._errors import DefinitionError, located, nearest
from slidax._names import quoted

from ..articulated import Articulated
from ..assemble import assemble
from ..joint import Joint
from .inertias import Feasible, Inertias
from .loader import mujoco, reading
from .mjcf_checks import check_compiled, check_spec, name_all
from .mjcf_geometry import drop_what_has_no_weight
from .mjcf_joints import joints_of
from .mjcf_motion import check_motion
from .mjcf_objects import leave_out_objects
from .named_files import require_named_files
from .notes import Notes
from .source import Source, elements, owner_at, read


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
    Contacts are ignored. Objects of a scene that are not fixed to the arm, such as a box on a table, are dropped with a
    DefinitionWarning. Other forces on the joints are errors: springs, tendons, equalities, compensated gravity.

    - `source`: path of the file, or its text.
    - `tip`: name of the body or site whose frame is the tip; optional if only one moving body carries no other.
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
    file = read(source, "mujoco", "from_urdf reads <robot>")
    notes = Notes()
    with located(str(file.path or "")):
        held = dict(locked or {})
        feasible = Feasible(inertias)
        _refuse_nan(file.root)
        with reading() as messages:
            spec = _spec(file)
            # The names are for all bodies: MuJoCo would join what is fixed to each other.
            spec.compiler.fusestatic = False
            name_all(spec)
            objects = leave_out_objects(spec, tip)
            check_spec(spec)
            attached = file.root.find(".//attach") is not None
            drop_what_has_no_weight(spec, file.folder, meshes, attached)
            feasible.of_bodies(spec)
            model = spec.compile()
            if any("NaN" in line for line in messages):
                raise DefinitionError("a file that this one includes has a number that is NaN")
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
        notes.add(f"{quoted(objects)} {'is' if len(objects) == 1 else 'are'} no part of the arm and left out")
    notes.warn(str(file.path or name), 2)
    return arm


def _spec(file: Source) -> Any:
    has_parts = any(file.root.find(f".//{tag}") is not None for tag in ("include", "model"))
    try:
        require_named_files(file.root, file.folder)
        if file.path is not None and has_parts:
            return mujoco().MjSpec.from_file(str(file.path))
        # From a file MuJoCo takes nothing but UTF-8 under a name that ends with .xml.
        spec = mujoco().MjSpec.from_string(file.text)
        spec.modelfiledir = f"{file.folder}/"
        return spec
    except ValueError as error:
        # It has the line only, and if files are included, it does not say of which.
        place = re.search(r"Element '(\w+)', line (\d+)", str(error))
        if place is None or has_parts:
            raise
        owner = owner_at(file.text, place[1], int(place[2]))
        raise ValueError(f"{error} in {owner}" if owner else str(error)) from error


def _refuse_nan(root: ET.Element) -> None:
    """Reject NaN, which MuJoCo takes for a missing number."""
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
        raise DefinitionError(f"which body or site is the tip? say tip=NAME; {', '.join(leaves)} carry no other")
    return str(leaves[0])


def _check_tip(model: Any, joints: Sequence[Joint], tip: str) -> None:
    if tip not in {joint.link for joint in joints}:
        known = [model.body(i).name for i in range(1, model.nbody)] + [model.site(i).name for i in range(model.nsite)]
        raise DefinitionError(f"`tip` names `{tip}`, which is no body and no site; {nearest(tip, known)}")


def _gravity(model: Any) -> list[float]:
    off = model.opt.disableflags & int(mujoco().mjtDisableBit.mjDSBL_GRAVITY)
    return [0.0, 0.0, 0.0] if off else [float(g) for g in model.opt.gravity]
