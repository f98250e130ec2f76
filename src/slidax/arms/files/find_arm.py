"""Find the arm in a robot file: the longest chain of joints, without fingers, cameras, heads and wheels."""

from __future__ import annotations

import contextlib
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from slidax.core.errors import DefinitionError, locate_errors, nearest_word
from slidax.core.files import open_file
from slidax.core.joint_names import quote_names

from .mjcf_checks import leave_out_objects, name_all
from .reading import mujoco, reading
from .source import MOST_BYTES, read_robot_file
from .urdf import LostError, position_near_zero, resolve_mimic
from .urdf_tree import limits_of, urdf_tree

FINGER = re.compile(r"finger|grip|jaw|claw|knuckle|thumb", re.IGNORECASE)
"""A joint of such a name opens or closes a hand."""

TIP = ("tcp", "tool0", "end_effector", "ee_link", "tool", "flange", "ee", "hand")
"""Words in the names of links where tools are held, the surest first."""

SHORT = 2
"""Joints one after the other in a finger, or in a head."""

ARM = 3
"""Joints one after the other that an arm has at least."""


@dataclass(frozen=True)
class ArmInFile:
    """Moving joints in order from the base, the link or body at the end, and positions of held joints, rad or m."""

    joints: tuple[str, ...]
    tip: str
    locked: dict[str, float]


@dataclass(frozen=True)
class _Hinge:
    """A joint between two links; `held` is its position if it does not move, None for a fixed joint."""

    name: str
    parent: str
    child: str
    held: float | None
    follows: bool = False

    @property
    def is_of_a_hand(self) -> bool:
        """True if it follows or leads another joint, or has the name of a finger."""
        return self.follows or FINGER.search(self.name) is not None


def find_arm(source: str | Path, tip: str | None = None) -> ArmInFile:
    """Return the arm in a robot file, URDF or MJCF.

    Followers and joints with names of fingers are held at the position nearest to 0, and so are side branches: at each
    branch the longest chain continues, and it ends where only fingers remain.

    - `source`: path of the file.
    - `tip`: the link or body at the end; by default the last moving link, or a tool's link fixed to it.

    Raises DefinitionError if the file is not readable, has no arm, or has several arms of one length.
    """
    is_urdf = Path(source).suffix.lower() != ".xml" or "<robot" in _beginning(source)
    with locate_errors(str(source)):
        hinges = _of_urdf(source) if is_urdf else _of_mjcf(source, tip)
        return _Tree(hinges).chain(tip)


def _beginning(source: str | Path) -> str:
    with open_file(Path(source), "the robot file", most=MOST_BYTES) as file:
        return file.read(4000).decode(errors="ignore")


class _Tree:
    def __init__(self, hinges: Sequence[_Hinge]) -> None:
        self._hinges = hinges
        self._below: dict[str, list[_Hinge]] = {}
        for hinge in hinges:
            self._below.setdefault(hinge.parent, []).append(hinge)
        self._carrier = {hinge.child: hinge for hinge in hinges}

    def chain(self, tip: str | None) -> ArmInFile:
        moving = self._to(tip) if tip is not None else self._longest()
        if not moving:
            raise DefinitionError("no joint moves the tip" if tip else f"there is no joint of an arm{self._left_out()}")
        end = tip if tip is not None else self._tip(moving[-1].child)
        names = tuple(hinge.name for hinge in moving)
        held = {each.name: each.held for each in self._hinges if each.held is not None and each.name not in names}
        return ArmInFile(names, end, held)

    def _left_out(self) -> str:
        """Joints that count as those of a hand, with the remedy."""
        names = [hinge.name for hinge in self._hinges if hinge.held is not None and hinge.is_of_a_hand]
        reason = "follow or lead others, or have names of fingers; name the arm's end by `--tip LINK`"
        return f": {quote_names(names)} {reason}" if names else ""

    def _to(self, tip: str) -> list[_Hinge]:
        if tip not in self._carrier:
            raise DefinitionError(f"`tip` names `{tip}`, which no joint carries; {nearest_word(tip, self._carrier)}")
        hinges: list[_Hinge] = []
        while tip in self._carrier:
            hinge = self._carrier[tip]
            if hinge.held is not None:
                hinges.append(hinge)
            tip = hinge.parent
        return hinges[::-1]

    def _longest(self) -> list[_Hinge]:
        roots = [hinge.parent for hinge in self._hinges if hinge.parent not in self._carrier]
        link, hinges = roots[0], list[_Hinge]()
        while True:
            ways = sorted(self._below.get(link, ()), key=self._length, reverse=True)
            ways = [hinge for hinge in ways if self._length(hinge) > 0]
            if not ways or (len(hinges) >= ARM and len(ways) > 1 and self._length(ways[0]) <= SHORT):
                return hinges
            if len(ways) > 1 and self._length(ways[0]) == self._length(ways[1]) and self._length(ways[0]) >= ARM:
                ends = ", ".join(f"`{self._tip(self._end(way))}`" for way in ways if self._length(way) >= ARM)
                raise DefinitionError(f"there are several arms; say which by its tip (`--tip`): {ends}")
            if ways[0].held is not None:
                hinges.append(ways[0])
            link = ways[0].child

    def _end(self, hinge: _Hinge) -> str:
        """The last moving link on the longest branch."""
        last = hinge.child
        while True:
            ways = sorted(self._below.get(hinge.child, ()), key=self._length, reverse=True)
            if not ways or self._length(ways[0]) == 0:
                return last
            hinge = ways[0]
            last = hinge.child if hinge.held is not None else last

    def _length(self, hinge: _Hinge) -> int:
        """Number of an arm's joints in series from this joint on."""
        if hinge.held is not None and hinge.is_of_a_hand:
            return 0
        further = max((self._length(branch) for branch in self._below.get(hinge.child, ())), default=0)
        return further + (hinge.held is not None)

    def _tip(self, link: str) -> str:
        """The last moving link, or a link fixed to it that has a tool's name."""
        fixed = [link]
        for place in fixed:
            fixed += [hinge.child for hinge in self._below.get(place, ()) if hinge.held is None]
        for word in TIP:
            for name in fixed:
                if re.search(rf"(^|[_\-/]){word}([_\-/]|\d|$)", name, re.IGNORECASE):
                    return name
        return link


def _of_urdf(source: str | Path) -> list[_Hinge]:
    tree = urdf_tree(read_robot_file(source, "robot", "from_mjcf reads <mujoco>").root)
    moving = [name for name in tree.order if tree.moves(name)]
    held = {name: position_near_zero(tree, name) for name in moving}
    follows = {name for name in moving if tree.joints[name].find("mimic") is not None}
    for name in follows:
        with contextlib.suppress(LostError):
            motion = resolve_mimic(tree, name, {})
            at = motion if isinstance(motion, float) else motion.ratio * held[motion.leader] + motion.offset
            with contextlib.suppress(DefinitionError):
                limits = limits_of(tree.joints[name])[0]
                held[name] = float(np.clip(at, limits.get("lower"), limits.get("upper")))
    leads = {mimic.get("joint", "") for name in moving for mimic in tree.joints[name].findall("mimic")}
    return [
        _Hinge(name, tree.parents[name], tree.children[name], held.get(name), name in follows | leads)
        for name in tree.order
    ]


def _of_mjcf(source: str | Path, tip: str | None) -> list[_Hinge]:
    with reading():
        library = mujoco()
        spec = library.MjSpec.from_file(str(source))
        name_all(spec)
        leave_out_objects(spec, tip)
        hinges = []
        coupled = {name for equality in spec.equalities for name in (equality.name1, equality.name2)}
        for body in spec.bodies:
            if body is spec.worldbody:
                continue
            parent = body.parent.name
            for joint in body.joints:
                limits = dict(zip(("lower", "upper"), map(float, joint.range), strict=True))
                degrees = spec.compiler.degree and joint.type == library.mjtJoint.mjJNT_HINGE
                limited = limits["lower"] < limits["upper"]
                value = _nearest_to_zero(limits if limited else {})
                hinges.append(
                    _Hinge(
                        joint.name,
                        parent,
                        body.name,
                        float(np.deg2rad(value)) if degrees else value,
                        joint.name in coupled,
                    )
                )
                parent = body.name
            if not body.joints:
                hinges.append(_Hinge("", parent, body.name, None))
        return hinges


def _nearest_to_zero(limits: Mapping[str, Any]) -> float:
    return float(np.clip(0.0, limits.get("lower"), limits.get("upper")))
