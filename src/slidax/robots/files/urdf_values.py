"""The values in a URDF file, each checked and named: other readers ignore most of what is wrong with them."""

from __future__ import annotations

import math
import re
import xml.etree.ElementTree as ET
from collections.abc import Mapping
from difflib import get_close_matches

from slidax._errors import DefinitionError

NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?", re.ASCII)

CHILDREN: Mapping[str, tuple[str, ...]] = {
    "robot": ("link", "joint"),
    "link": ("inertial",),
    "inertial": ("origin", "mass", "inertia"),
    "joint": ("origin", "parent", "child", "axis", "dynamics", "limit", "mimic"),
}
"""The elements that define the motion, and those around them."""

NUMBERS: Mapping[str, Mapping[str, int]] = {
    "origin": {"xyz": 3, "rpy": 3},
    "axis": {"xyz": 3},
    "mass": {"value": 1},
    "inertia": {"ixx": 1, "ixy": 1, "ixz": 1, "iyy": 1, "iyz": 1, "izz": 1},
    "dynamics": {"damping": 1, "friction": 1},
    "limit": {"lower": 1, "upper": 1, "effort": 1, "velocity": 1},
    "mimic": {"multiplier": 1, "offset": 1},
}
"""How many numbers each attribute has."""

REQUIRED: Mapping[str, tuple[str, ...]] = {
    "axis": ("xyz",),
    "mass": ("value",),
    "inertia": ("ixx", "ixy", "ixz", "iyy", "iyz", "izz"),
    "inertial": ("mass", "inertia"),
}
"""Attributes, or elements inside, without which an element says nothing."""


def check(owner: str, element: ET.Element) -> None:
    """Refuses an element, or one inside of it, that is misspelled, given twice, not complete or with a bad number.

    - `owner`: whose element it is: "link `forearm`".
    - `element`: of the motion: `CHILDREN` and `NUMBERS` have those that are looked at.

    Raises DefinitionError naming the owner.
    """
    tag = element.tag
    known = CHILDREN.get(tag, ())
    for child in element:
        if child.tag in known:
            if tag != "robot":
                check(owner, child)
        elif known:
            _refuse_misspelled(owner, child.tag, known, f"in <{tag}>")
    if tag == "robot":
        return
    for name in known:
        if len(element.findall(name)) > 1:
            raise DefinitionError(f"{owner} has <{name}> twice; remove one")
    for name in REQUIRED.get(tag, ()):
        if element.get(name) is None and element.find(name) is None:
            kind = "attribute" if name in NUMBERS.get(tag, ()) else "element"
            raise DefinitionError(f"<{tag}> of {owner} has no {kind} `{name}`")
    _check_attributes(owner, element)


def _check_attributes(owner: str, element: ET.Element) -> None:
    numbers = NUMBERS.get(element.tag, {})
    for name, text in element.attrib.items():
        if name in numbers:
            _numbers(owner, element.tag, name, text, numbers[name])
        elif numbers:
            _refuse_misspelled(owner, name, tuple(numbers), f"in <{element.tag}>")


def _refuse_misspelled(owner: str, name: str, known: tuple[str, ...], place: str) -> None:
    """What is like something known but is not: a reader would ignore it. All else is some program's extension."""
    close = [] if "_" in name or "}" in name else get_close_matches(name.lower(), known, n=1, cutoff=0.66)
    if close:
        raise DefinitionError(f"{owner} has `{name}` {place}, which URDF does not know; did you mean `{close[0]}`?")


def _numbers(owner: str, tag: str, name: str, text: str, count: int) -> tuple[float, ...]:
    words = text.split()
    for word in words:
        if not NUMBER.fullmatch(word) or not math.isfinite(float(word)):
            raise DefinitionError(f"{name} in <{tag}> of {owner} must be a finite number; got `{word}`")
    if len(words) != count:
        needed = "one number" if count == 1 else f"{count} numbers"
        raise DefinitionError(f"{name} in <{tag}> of {owner} must be {needed}; got `{text}`")
    return tuple(float(word) for word in words)


def number(element: ET.Element | None, name: str) -> float | None:
    """A number in a checked element; None if it is not given.

    - `element`: None if it is not there.
    - `name`: of the attribute.
    """
    text = element.get(name) if element is not None else None
    return None if text is None else float(text)


def limits_of(joint: ET.Element) -> tuple[dict[str, float], list[str]]:
    """`lower`, `upper`, `velocity` and `torque` of a joint that moves, and the names of those that are not given.

    A velocity or an effort of 0 is not given, and so are ends of the range that are both 0: programs that export robot
    files write so, and a joint that cannot move is "fixed". If one end is given, the other is 0 by the standard.

    - `joint`: checked; "revolute", "continuous" or "prismatic".

    Raises DefinitionError, naming the joint, if one is invalid.
    """
    name, given = joint.get("name"), joint.find("limit")
    endless = joint.get("type") == "continuous"
    found: dict[str, float] = {}
    for attribute, field in (("velocity", "velocity"), ("effort", "torque")):
        value = number(given, attribute) or 0.0
        if value < 0:
            raise DefinitionError(
                f"{attribute} in <limit> of joint `{name}` must be > 0; got {value:g}; correct it, or say limits=False "
                f"to read no limits"
            )
        if value > 0:
            found[field] = value
    lower, upper = number(given, "lower") or 0.0, number(given, "upper") or 0.0
    if not endless and (lower, upper) != (0.0, 0.0):
        if not lower < upper:
            raise DefinitionError(
                f"<limit> of joint `{name}` must have lower < upper; got {lower:g} and {upper:g}; "
                f'type="fixed" is for a joint that does not move'
            )
        found |= {"lower": lower, "upper": upper}
    # A joint without end needs no limits at all, but if it has some they should be complete.
    needed = (("upper", "position"), ("velocity", "velocity"), ("torque", "effort"))
    missing = [shown for field, shown in needed if field not in found and not (endless and field == "upper")]
    return found, [] if endless and given is None else missing
