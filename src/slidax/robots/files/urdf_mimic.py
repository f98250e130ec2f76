"""Joints of a URDF file that are held: followers that are no part of the arm, and those that move no mass."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from slidax._errors import DefinitionError, nearest

from .notes import Notes
from .urdf_tree import Tree
from .urdf_values import limits_of, number

Mimics = Literal["held", "followed"]

FOLLOWED = 'mimics="followed"'

MOST_NAMES = 3
"""Followers that a warning lists by name."""


@dataclass(frozen=True)
class Following:
    """Position of a joint that follows another: `ratio` times the leader's, plus `offset`.

    - `leader`: name of a joint that moves by itself.
    - `ratio`: of the positions and of the velocities.
    - `offset`: position of the follower while the leader's is 0, rad or m.
    """

    leader: str
    ratio: float
    offset: float


@dataclass(frozen=True)
class Mimicry:
    """The followers of a file.

    - `held`: positions of joints that do not move, by name; those that the user holds are among them.
    - `following`: the followers that move.
    """

    held: dict[str, float]
    following: dict[str, Following]


class LostError(Exception):
    """A follower has no leader that could be found."""


def mimicry_of(tree: Tree, tip: str, locked: Mapping[str, float], mimics: str, notes: Notes) -> Mimicry:
    """Which followers are held, and which follow.

    A follower is held if a joint that it follows, also through others, is held or fixed. Those that are not between the
    base and the tip are held where their leader is nearest to 0, and so is a leader without any part in the arm.

    - `tree`: of the file.
    - `tip`: name of the link at the end of the arm.
    - `locked`: positions of the joints that the user holds.
    - `mimics`: "held" as above, or "followed" to let followers move with their leader wherever they are.
    - `notes`: gets what is held.

    Raises DefinitionError, naming the joint, if one between base and tip follows a joint that is not there, or itself.
    """
    if mimics not in get_args(Mimics):
        raise DefinitionError(f"`mimics` must be `held` or `followed`; got `{mimics}`")
    between = tree.path_to(tip)
    held, following = dict(locked), dict[str, Following]()
    for name in tree.order:
        joint = tree.joints[name]
        if joint.find("mimic") is None or not tree.moves(name) or name in locked:
            continue
        try:
            found = resolved(tree, name, locked)
        except LostError as error:
            place = position_near_zero(tree, name)
            if name in between:
                raise DefinitionError(
                    f"{error}; locked={{'{name}': {place:g}}} holds the joint, or remove its <mimic>"
                ) from None
            held[name] = place
            notes.add(f"{error}: {{}} is held at {place:g}; locked={{'{name}': POSITION}} holds it elsewhere", _j(name))
            continue
        if isinstance(found, float):
            held[name] = found
            leader = _leader(tree, name)
            notes.add(
                f"{{}} mimics joint `{leader}`, which does not move: it is held at {found:g}; "
                f"locked={{'{name}': POSITION}} holds it elsewhere",
                _j(name),
            )
        else:
            following[name] = found
    if mimics == "held":
        _hold(tree, tip, between, held, following, notes)
    return Mimicry(held, following)


def hold_massless(tree: Tree, tip: str, mimicry: Mimicry, rotors: Iterable[str], notes: Notes) -> None:
    """Hold the joints that move no mass and are not between the base and the tip: they have no part in the motion.

    - `tree`: of the file.
    - `tip`: name of the link at the end of the arm.
    - `mimicry`: gets the joints that are held.
    - `rotors`: names of joints with rotors of their own, which move without a mass.
    - `notes`: gets what is held.
    """
    between = tree.path_to(tip)
    if not any(_mass(tree, name) for name in between):
        return
    carried: dict[str, float] = {}
    for name in reversed(tree.order):
        parent = tree.carriers.get(tree.parents[name])
        carried[name] = carried.get(name, 0.0) + _mass(tree, name)
        if parent is not None:
            carried[parent] = carried.get(parent, 0.0) + carried[name]
    coupled = {*mimicry.following, *(one.leader for one in mimicry.following.values())}
    for name in tree.order:
        if carried[name] == 0.0 and tree.moves(name) and name not in {*between, *coupled, *mimicry.held, *rotors}:
            mimicry.held[name] = position_near_zero(tree, name)
            notes.add(
                "{} moves no mass and is not between the base and the tip: it is held; give its link a mass", _j(name)
            )


def _mass(tree: Tree, joint: str) -> float:
    return abs(number(tree.links[tree.children[joint]].find("inertial/mass"), "value") or 0.0)


def position_near_zero(tree: Tree, name: str) -> float:
    """The position nearest to 0 that a joint can have; 0 for one that is fixed.

    - `tree`: of the file.
    - `name`: of the joint.
    """
    try:
        limits = limits_of(tree.joints[name])[0] if tree.moves(name) else {}
    except DefinitionError:
        limits = {}
    return float(np.clip(0.0, limits.get("lower"), limits.get("upper")))


def _hold(
    tree: Tree, tip: str, between: set[str], held: dict[str, float], following: dict[str, Following], notes: Notes
) -> None:
    groups: dict[str, list[str]] = {}
    for name, follow in following.items():
        groups.setdefault(follow.leader, []).append(name)
    for leader, followers in groups.items():
        outside = [name for name in followers if name not in between]
        apart = leader not in between and len(outside) == len(followers)
        if not outside:
            continue
        at = position_near_zero(tree, leader)
        places = ({leader: at} if apart else {}) | {
            name: following[name].ratio * at + following[name].offset for name in outside
        }
        for name in outside:
            del following[name]
        held |= places
        listed = ", ".join(f"'{name}': {place:.6g}" for name, place in places.items())
        names = ", ".join(f"`{name}`" for name in outside[:MOST_NAMES])
        more = f" and {len(outside) - MOST_NAMES} more" if len(outside) > MOST_NAMES else ""
        notes.add(
            f"{{}} leads {names}{more}, which {'is' if len(outside) == 1 else 'are'} not between the base and the tip "
            f"`{tip}`: locked={{{listed}}} is assumed; give other positions by `locked`, or let them move together by "
            f"{FOLLOWED}",
            _j(leader),
        )


def resolved(tree: Tree, name: str, locked: Mapping[str, float]) -> Following | float:
    """How a joint follows the first one that moves by itself, or its position if there is none.

    - `tree`: of the file.
    - `name`: of the joint.
    - `locked`: positions of the joints that are held.

    Raises LostError if it follows a joint that is not there, or itself.
    """
    ratio, offset, at, seen = 1.0, 0.0, name, [name]
    while True:
        mimic = tree.joints[at].find("mimic")
        if at in locked:
            return ratio * locked[at] + offset
        if not tree.moves(at) or ratio == 0.0:
            return offset
        if mimic is None:
            return Following(at, ratio, offset)
        leader = _leader(tree, at)
        if leader not in tree.joints:
            raise LostError(
                f"joint `{at}` mimics joint `{leader}`, which does not exist; {nearest(leader, tree.joints)}"
            )
        multiplier = number(mimic, "multiplier")
        offset += ratio * (number(mimic, "offset") or 0.0)
        ratio *= 1.0 if multiplier is None else multiplier
        if leader in seen:
            raise LostError(f"joint `{at}` mimics joint `{leader}`, which follows it in turn")
        seen.append(leader)
        at = leader


def _leader(tree: Tree, name: str) -> str:
    mimic = tree.joints[name].find("mimic")
    assert mimic is not None
    return mimic.get("joint", "").strip()


def _j(name: str) -> str:
    return f"joint `{name}`"
