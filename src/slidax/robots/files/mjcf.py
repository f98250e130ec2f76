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
    """An arm from an MJCF file, read and compiled by MuJoCo (`pip install 'slidax[robots]'`).

    Positions are MuJoCo's, with `ref` in them. Damping is read as viscous friction, `frictionloss` as Coulomb friction,
    and the torque limits come from `actuatorfrcrange` and from the joints' actuators, of a range that is not symmetric
    the smaller side. Contacts are not read. Objects of a scene that are not fixed to the arm, such as a box on a
    table, are left out with a DefinitionWarning. What else acts on the joints by itself is refused: springs, tendons,
    equalities, compensated gravity.

    - `source`: path of the file, or its text.
    - `tip`: name of the body or site whose frame is the tip; may be left out if of those that move only one carries
      no other.
    - `locked`: joints that do not move, such as a gripper's, with their positions, rad or m.
    - `gravity`: its acceleration in the world's frame [3], m/s²; by default the file's.
    - `meshes`: whether every mesh must be there. Only those are read that a body's inertia comes from.
    - `inertias`: for an inertia that no rigid body can have, such as one with a principal moment greater than the sum
      of the others. "given" replaces it by the nearest that a body can have if no principal moment is negative and none
      changes by more than 1 % of the largest, and refuses it otherwise; "nearest" replaces it always, "strict" never.
      A replacement is a DefinitionWarning with its size.

    Raises DefinitionError, naming body, joint or what it is about, if the file is not one arm on a fixed base, or has
    something that such an arm cannot have.
    """
    given = read(source, "mujoco", "from_urdf reads <robot>")
    notes = Notes()
    with located(str(given.path or "")):
        held = dict(locked or {})
        feasible = Feasible(inertias)
        _refuse_nan(given.root)
        with reading() as said:
            spec = _spec(given)
            # The names are for all bodies: MuJoCo would join what is fixed to each other.
            spec.compiler.fusestatic = False
            name_all(spec)
            objects = leave_out_objects(spec, tip)
            check_spec(spec)
            attached = given.root.find(".//attach") is not None
            drop_what_has_no_weight(spec, given.folder, meshes, attached)
            feasible.of_bodies(spec)
            model = spec.compile()
            if any("NaN" in line for line in said):
                raise DefinitionError("a file that this one includes has a number that is NaN")
            check_compiled(model, held)
            joints = joints_of(model, tip)
            check_motion(model, joints, held)
            end = tip if tip is not None else _only_leaf(model)
            _check_tip(model, joints, end)
            down = _gravity(model) if gravity is None else gravity
        name = given.root.get("model") or "robot"
        arm = assemble(joints, tip=end, locked=held, gravity=down, name=name)
    for line in said:
        notes.add(f"MuJoCo says: {line}")
    feasible.add_to(notes)
    if objects:
        notes.add(f"{quoted(objects)} {'is' if len(objects) == 1 else 'are'} no part of the arm and left out")
    notes.warn(str(given.path or name), 2)
    return arm


def _spec(given: Source) -> Any:
    has_parts = any(given.root.find(f".//{tag}") is not None for tag in ("include", "model"))
    try:
        require_named_files(given.root, given.folder)
        if given.path is not None and has_parts:
            return mujoco().MjSpec.from_file(str(given.path))
        # From a file MuJoCo takes nothing but UTF-8 under a name that ends with .xml.
        spec = mujoco().MjSpec.from_string(given.text)
        spec.modelfiledir = f"{given.folder}/"
        return spec
    except ValueError as error:
        # It has the line only, and if files are included, it does not say of which.
        place = re.search(r"Element '(\w+)', line (\d+)", str(error))
        if place is None or has_parts:
            raise
        owner = owner_at(given.text, place[1], int(place[2]))
        raise ValueError(f"{error} in {owner}" if owner else str(error)) from error


def _refuse_nan(root: ET.Element) -> None:
    """MuJoCo takes NaN for a number that is not given, and goes on with another."""
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
