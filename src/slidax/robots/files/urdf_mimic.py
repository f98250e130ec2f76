"""Mimic joints of a URDF file: followers that are held because they are not in the arm, and joints without mass."""

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
    """A joint that follows another: its position is `ratio` times the leader's, plus `offset` [rad or m]."""

    leader: str
    ratio: float
    offset: float


@dataclass(frozen=True)
class Mimicry:
    """Mimic joints: positions of held joints by name, including the user's, and followers that move."""

    held: dict[str, float]
    following: dict[str, Following]


class LostError(Exception):
    """A follower has no valid leader."""


def mimicry_of(tree: Tree, tip: str, locked: Mapping[str, float], mimics: str, notes: Notes) -> Mimicry:
    """Decide which followers are held and which follow.

    A follower is held if a joint that it follows, also through others, is held or fixed. Followers outside the path
    from base to tip are held where their leader is nearest to 0, and so is a leader that is not needed for the arm.

    - `locked`: positions of the joints that the user holds.
    - `mimics`: "held" as above, or "followed" to let all followers move with their leader.
    - `notes`: receives the held joints.

    Raises DefinitionError, naming the joint, if one between base and tip follows an unknown joint or itself.
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
            leader_motion = resolved(tree, name, locked)
        except LostError as error:
            place = position_near_zero(tree, name)
            if name in between:
                raise DefinitionError(
                    f"{error}; locked={{'{name}': {place:g}}} holds the joint, or remove its <mimic>"
                ) from None
            held[name] = place
            notes.add(f"{error}: {{}} is held at {place:g}; locked={{'{name}': POSITION}} holds it elsewhere", _j(name))
            continue
        if isinstance(leader_motion, float):
            held[name] = leader_motion
            leader = _leader(tree, name)
            notes.add(
                f"{{}} mimics joint `{leader}`, which does not move: it is held at {leader_motion:g}; "
                f"locked={{'{name}': POSITION}} holds it elsewhere",
                _j(name),
            )
        else:
            following[name] = leader_motion
    if mimics == "held":
        _hold(tree, tip, between, held, following, notes)
    return Mimicry(held, following)


def hold_massless(tree: Tree, tip: str, mimicry: Mimicry, rotors: Iterable[str], notes: Notes) -> None:
    """Hold joints without mass behind them outside the path from base to tip: they do not influence the motion.

    - `mimicry`: receives the held joints.
    - `rotors`: names of joints with rotor inertia, which move without a mass.
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
    coupled = {*mimicry.following, *(follower.leader for follower in mimicry.following.values())}
    for name in tree.order:
        if carried[name] == 0.0 and tree.moves(name) and name not in {*between, *coupled, *mimicry.held, *rotors}:
            mimicry.held[name] = position_near_zero(tree, name)
            notes.add(
                "{} moves no mass and is not between the base and the tip: it is held; give its link a mass", _j(name)
            )


def _mass(tree: Tree, joint: str) -> float:
    return abs(number(tree.links[tree.children[joint]].find("inertial/mass"), "value") or 0.0)


def position_near_zero(tree: Tree, name: str) -> float:
    """Return the position nearest to 0 within a joint's limits; 0 for a fixed joint."""
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
    """Return how a joint follows the first joint that moves by itself, or its position if there is none.

    Raises LostError if it follows an unknown joint or itself.
    """
    ratio, offset, at, passed = 1.0, 0.0, name, [name]
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
        if leader in passed:
            raise LostError(f"joint `{at}` mimics joint `{leader}`, which follows it in turn")
        passed.append(leader)
        at = leader


def _leader(tree: Tree, name: str) -> str:
    mimic = tree.joints[name].find("mimic")
    assert mimic is not None
    return mimic.get("joint", "").strip()


def _j(name: str) -> str:
    return f"joint `{name}`"
