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
from .urdf import InvalidLeaderError, position_near_zero, resolve_mimic
from .urdf_tree import limits_of, urdf_tree

FINGER = re.compile(r"finger|grip|jaw|claw|knuckle|thumb", re.IGNORECASE)
"""Parts of the names of joints that open or close a hand."""

TIP = ("tcp", "tool0", "end_effector", "ee_link", "tool", "flange", "ee", "hand")
"""Words in the names of links at which a tool is mounted, the most specific first."""

SHORT = 2
"""Most joints in series in a finger or a head."""

ARM = 3
"""Least number of joints in series in an arm."""


@dataclass(frozen=True)
class ArmInFile:
    """The arm in a robot file.

    - `joints`: names of the moving joints in order from the base.
    - `tip`: name of the link or body at the end.
    - `locked`: fixed positions of all other movable joints, by name, rad or m.
    """

    joints: tuple[str, ...]
    tip: str
    locked: dict[str, float]


@dataclass(frozen=True)
class _Edge:
    """A joint between two links.

    - `held`: its position if it is not part of the arm, rad or m; None for a fixed joint.
    - `follows`: True if it follows or leads another joint.
    """

    name: str
    parent: str
    child: str
    held: float | None
    follows: bool = False

    @property
    def is_of_a_hand(self) -> bool:
        """True if the joint follows or leads another, or has the name of a finger."""
        return self.follows or FINGER.search(self.name) is not None


def find_arm(source: str | Path, tip: str | None = None) -> ArmInFile:
    """Return the arm in a robot file, URDF or MJCF.

    The arm is the longest chain of moving joints, and ends where only fingers remain. All other joints are held near 0:
    side branches, joints that follow or lead others, and joints with names of fingers.

    - `source`: path of the file.
    - `tip`: the link or body at the end; by default the last moving link, or a tool's link fixed to it.

    Raises DefinitionError if the file is not readable, has no arm, or has several arms of the same length.
    """
    is_urdf = Path(source).suffix.lower() != ".xml" or "<robot" in _beginning(source)
    with locate_errors(str(source)):
        edges = _of_urdf(source) if is_urdf else _of_mjcf(source, tip)
        return _Tree(edges).arm_to(tip)


def _beginning(source: str | Path) -> str:
    with open_file(Path(source), "the robot file", most=MOST_BYTES) as file:
        return file.read(4000).decode(errors="ignore")


class _Tree:
    def __init__(self, edges: Sequence[_Edge]) -> None:
        self._edges = edges
        self._below: dict[str, list[_Edge]] = {}
        for edge in edges:
            self._below.setdefault(edge.parent, []).append(edge)
        self._carrier = {edge.child: edge for edge in edges}

    def arm_to(self, tip: str | None) -> ArmInFile:
        moving = self._path_to(tip) if tip is not None else self._longest()
        if not moving:
            message = (
                f"no joint moves the tip `{tip}`" if tip else f"no joint is part of an arm{self._left_out_message()}"
            )
            raise DefinitionError(message)
        end = tip if tip is not None else self._tip(moving[-1].child)
        names = tuple(edge.name for edge in moving)
        held = {each.name: each.held for each in self._edges if each.held is not None and each.name not in names}
        return ArmInFile(names, end, held)

    def _left_out_message(self) -> str:
        """Return text on the joints that count as those of a hand, with the remedy; empty if there are none."""
        names = [edge.name for edge in self._edges if edge.held is not None and edge.is_of_a_hand]
        reason = "follow or lead others, or have names of fingers; name the arm's end by `tip` (`--tip LINK`)"
        return f": {quote_names(names)} {reason}" if names else ""

    def _path_to(self, tip: str) -> list[_Edge]:
        if tip not in self._carrier:
            raise DefinitionError(
                f"`tip` must be a link of the file, but not its root; got `{tip}`: {nearest_word(tip, self._carrier)}"
            )
        edges: list[_Edge] = []
        while tip in self._carrier:
            edge = self._carrier[tip]
            if edge.held is not None:
                edges.append(edge)
            tip = edge.parent
        return edges[::-1]

    def _longest(self) -> list[_Edge]:
        roots = [edge.parent for edge in self._edges if edge.parent not in self._carrier]
        link, edges = roots[0], list[_Edge]()
        while True:
            branches = sorted(self._below.get(link, ()), key=self._length, reverse=True)
            branches = [edge for edge in branches if self._length(edge) > 0]
            if not branches or (len(edges) >= ARM and len(branches) > 1 and self._length(branches[0]) <= SHORT):
                return edges
            longest = [branch for branch in branches if self._length(branch) == self._length(branches[0])]
            if len(longest) > 1 and self._length(branches[0]) >= ARM:
                arms = [branch for branch in branches if self._length(branch) >= ARM]
                ends = ", ".join(f"`{self._tip(self._end(branch))}`" for branch in arms)
                raise DefinitionError(f"there are several arms; choose one by its tip (`--tip`): {ends}")
            if branches[0].held is not None:
                edges.append(branches[0])
            link = branches[0].child

    def _end(self, edge: _Edge) -> str:
        """Return the last moving link on the longest branch."""
        last = edge.child
        while True:
            branches = sorted(self._below.get(edge.child, ()), key=self._length, reverse=True)
            if not branches or self._length(branches[0]) == 0:
                return last
            edge = branches[0]
            last = edge.child if edge.held is not None else last

    def _length(self, edge: _Edge) -> int:
        """Return the largest number of moving joints in series from this joint on; 0 for a joint of a hand."""
        if edge.held is not None and edge.is_of_a_hand:
            return 0
        further = max((self._length(branch) for branch in self._below.get(edge.child, ())), default=0)
        return further + (edge.held is not None)

    def _tip(self, link: str) -> str:
        """Return the link fixed to `link` that has a tool's name; `link` itself if there is none."""
        fixed = [link]
        for end in fixed:
            fixed += [edge.child for edge in self._below.get(end, ()) if edge.held is None]
        for word in TIP:
            for name in fixed:
                if re.search(rf"(^|[_\-/]){word}([_\-/]|\d|$)", name, re.IGNORECASE):
                    return name
        return link


def _of_urdf(source: str | Path) -> list[_Edge]:
    tree = urdf_tree(read_robot_file(source, "robot", "from_mjcf reads <mujoco>").root)
    moving = [name for name in tree.order if tree.moves(name)]
    held = {name: position_near_zero(tree, name) for name in moving}
    follows = {name for name in moving if tree.joints[name].find("mimic") is not None}
    for name in follows:
        with contextlib.suppress(InvalidLeaderError):
            motion = resolve_mimic(tree, name, {})
            at = motion if isinstance(motion, float) else motion.ratio * held[motion.leader] + motion.offset
            with contextlib.suppress(DefinitionError):
                limits = limits_of(tree.joints[name])[0]
                held[name] = float(np.clip(at, limits.get("lower"), limits.get("upper")))
    leads = {mimic.get("joint", "") for name in moving for mimic in tree.joints[name].findall("mimic")}
    return [
        _Edge(name, tree.parents[name], tree.children[name], held.get(name), name in follows | leads)
        for name in tree.order
    ]


def _of_mjcf(source: str | Path, tip: str | None) -> list[_Edge]:
    with reading():
        library = mujoco()
        spec = library.MjSpec.from_file(str(source))
        name_all(spec)
        leave_out_objects(spec, tip)
        edges = []
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
                edges.append(
                    _Edge(
                        joint.name,
                        parent,
                        body.name,
                        float(np.deg2rad(value)) if degrees else value,
                        joint.name in coupled,
                    )
                )
                parent = body.name
            if not body.joints:
                edges.append(_Edge("", parent, body.name, None))
        return edges


def _nearest_to_zero(limits: Mapping[str, Any]) -> float:
    return float(np.clip(0.0, limits.get("lower"), limits.get("upper")))
