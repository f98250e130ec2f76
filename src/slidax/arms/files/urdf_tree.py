"""Links and joints of a URDF file as one tree, with every value checked."""

from __future__ import annotations

import math
import re
import xml.etree.ElementTree as ET
from collections.abc import Mapping
from dataclasses import dataclass
from difflib import get_close_matches
from functools import cached_property

from slidax.core.errors import DefinitionError, nearest_word

from .reading import Notes

NUMBER = re.compile(r"[+-]?(\d+(\.\d*)?|\.\d+)([eE][+-]?\d+)?", re.ASCII)

CHILDREN: Mapping[str, tuple[str, ...]] = {
    "robot": ("link", "joint"),
    "link": ("inertial",),
    "inertial": ("origin", "mass", "inertia"),
    "joint": ("origin", "parent", "child", "axis", "dynamics", "limit", "mimic"),
}
"""Elements that define the motion, by the element that contains them."""

NUMBERS: Mapping[str, Mapping[str, int]] = {
    "origin": {"xyz": 3, "rpy": 3, "quat_xyzw": 4},
    "axis": {"xyz": 3},
    "mass": {"value": 1},
    "inertia": {"ixx": 1, "ixy": 1, "ixz": 1, "iyy": 1, "iyz": 1, "izz": 1},
    "dynamics": {"damping": 1, "friction": 1},
    "limit": {"lower": 1, "upper": 1, "effort": 1, "velocity": 1},
    "mimic": {"multiplier": 1, "offset": 1},
}
"""Number of values of each attribute."""

REQUIRED: Mapping[str, tuple[str, ...]] = {
    "axis": ("xyz",),
    "mass": ("value",),
    "inertia": ("ixx", "ixy", "ixz", "iyy", "iyz", "izz"),
    "inertial": ("mass", "inertia"),
}
"""Attributes or inner elements that an element must have."""


SHAPING = ("origin", "axis", "mass", "inertia")
"""Elements whose attributes all define the motion. In others, programs add attributes of their own, such as `jerk`."""

UPRIGHT = 1e-9
"""Cosine of the pitch below which roll and yaw cannot be distinguished."""

MOTION = ("axis", "dynamics", "limit", "mimic")
"""Elements without a meaning in a fixed joint."""


def check_element(owner: str, element: ET.Element, notes: Notes) -> None:
    """Reject an element, or one inside it, that is misspelled, contradictory or incomplete.

    - `owner`: the link or joint with this element, for messages: "link `forearm`".
    - `element`: an element that `CHILDREN` or `NUMBERS` lists.
    - `notes`: receives the ignored elements.

    Raises DefinitionError naming the owner.
    """
    tag = element.tag
    known = CHILDREN.get(tag, ())
    still = tag == "joint" and element.get("type") == "fixed"
    for child in element:
        if child.tag not in known:
            if _check_unknown(owner, element, child.tag, known) and tag not in NUMBERS:
                notes.add(
                    f"<{child.tag}> in <{tag}> of {{}} is not read, as URDF has no such element; remove it", owner
                )
        elif still and child.tag in MOTION:
            _ignore_element(owner, child, notes)
        elif tag != "robot":
            check_element(owner, child, notes)
    if tag == "robot":
        return
    for name in known:
        if len(element.findall(name)) > 1:
            raise DefinitionError(f"{owner} has <{name}> twice; remove one")
    for name in REQUIRED.get(tag, ()):
        if element.get(name) is None and element.find(name) is None:
            kind = "attribute" if name in NUMBERS.get(tag, ()) else "element"
            raise DefinitionError(f"<{tag}> of {owner} has no {kind} `{name}`")
    _check_attributes(owner, element, notes)
    if element.get("quat_xyzw") is not None:
        _convert_quaternion(owner, element)


def same_element(first: ET.Element, second: ET.Element) -> bool:
    """True if two elements have the same content."""
    return (
        first.tag == second.tag
        and first.attrib == second.attrib
        and (first.text or "").strip() == (second.text or "").strip()
        and len(first) == len(second)
        and all(map(same_element, first, second))
    )


def _convert_quaternion(owner: str, origin: ET.Element) -> None:
    """Convert a quaternion, from newer versions of URDF, to roll, pitch and yaw."""
    x, y, z, w = (float(word) for word in origin.attrib.pop("quat_xyzw").split())
    size = math.hypot(x, y, z, w)
    if "rpy" in origin.attrib or size == 0.0:
        raise DefinitionError(
            f"<origin> of {owner} must have either `rpy` or a `quat_xyzw` that is not 0; remove one of them"
        )
    x, y, z, w = x / size, y / size, z / size, w / size
    across, along = 1.0 - 2.0 * (y * y + z * z), 2.0 * (w * z + x * y)
    flat = math.hypot(across, along)
    pitch = math.atan2(2.0 * (w * y - z * x), flat)
    if flat > UPRIGHT:
        roll, yaw = math.atan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y)), math.atan2(along, across)
    else:
        # Gimbal lock: roll and yaw rotate about the same axis.
        roll, yaw = 0.0, math.atan2(2.0 * (w * z - x * y), 1.0 - 2.0 * (x * x + z * z))
    origin.set("rpy", f"{roll!r} {pitch!r} {yaw!r}")


def _ignore_element(owner: str, element: ET.Element, notes: Notes) -> None:
    """Ignore an element of a fixed joint, since it means nothing."""
    try:
        check_element(owner, element, Notes())
    except DefinitionError as error:
        notes.add(f"<{element.tag}> of {{}} is not read, as the joint is fixed ({error}); remove it", owner)


def _check_attributes(owner: str, element: ET.Element, notes: Notes) -> None:
    tag = element.tag
    numbers = NUMBERS.get(tag, {})
    for name, text in element.attrib.items():
        if name in numbers:
            _numbers(owner, tag, name, text, numbers[name])
        elif numbers:
            like = _check_unknown(owner, element, name, tuple(numbers))
            if like or tag in SHAPING:
                notes.add(f"`{name}` in <{tag}> of {{}} is not read, as URDF has no such attribute; remove it", owner)


def _check_unknown(owner: str, element: ET.Element, name: str, known: tuple[str, ...]) -> bool:
    """True if a name is similar to a known one that is also present; raise an error if the known one is missing.

    A name that is similar to no known one counts as an extension of some program.
    """
    close = [] if "_" in name or ":" in name else get_close_matches(name.lower(), known, n=1, cutoff=0.66)
    if close and element.get(close[0]) is None and element.find(close[0]) is None:
        raise DefinitionError(
            f"{owner} has `{name}` in <{element.tag}>, which URDF does not know; did you mean `{close[0]}`?"
        )
    return bool(close)


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
    """Return an attribute of a checked element as a number; None if it is missing."""
    text = element.get(name) if element is not None else None
    return None if text is None else float(text)


def limits_of(joint: ET.Element, notes: Notes | None = None) -> tuple[dict[str, float], list[str]]:
    """Return `lower`, `upper`, `velocity` and `torque` of a moving joint, and the names of missing limits.

    A velocity or an effort of 0 or -1 counts as missing, and so does a range from 0 to 0: exporters write these values
    for unknown limits. An end that is missing is 0, as the URDF standard says. If upper < 0 < lower, the two ends are
    exchanged.

    - `joint`: checked element of type "revolute", "continuous" or "prismatic".
    - `notes`: receives the assumptions.

    Raises DefinitionError, naming the joint, for an invalid limit.
    """
    notes = Notes() if notes is None else notes
    name, limit_element = joint.get("name", "").strip(), joint.find("limit")
    endless = joint.get("type") == "continuous"
    limits: dict[str, float] = {}
    for attribute, field in (("velocity", "velocity"), ("effort", "torque")):
        value = number(limit_element, attribute) or 0.0
        if value == -1.0:
            notes.add(
                f"{attribute} -1 in <limit> of {{}} counts as missing; write the {attribute} > 0 there",
                f"joint `{name}`",
            )
        elif value < 0:
            raise DefinitionError(
                f"{attribute} in <limit> of joint `{name}` must be > 0; got {value:g}; correct it, or use limits=False "
                f"to read no limits"
            )
        elif value > 0:
            limits[field] = value
    if not endless:
        limits |= _range_of(name, limit_element, notes)
    # A continuous joint needs no limits, but if it has some, they should be complete.
    needed = (("upper", "position"), ("velocity", "velocity"), ("torque", "effort"))
    missing = [shown for field, shown in needed if field not in limits and not (endless and field == "upper")]
    return limits, [] if endless and limit_element is None else missing


def _range_of(name: str, limit_element: ET.Element | None, notes: Notes) -> dict[str, float]:
    ends = number(limit_element, "lower"), number(limit_element, "upper")
    lower, upper = ends[0] or 0.0, ends[1] or 0.0
    if (lower, upper) == (0.0, 0.0):
        return {}
    if upper < 0.0 < lower:
        notes.add(
            f"<limit> of {{}} has lower {lower:g} > upper {upper:g}: they are read as exchanged, {upper:g} to "
            f"{lower:g}; write them in order",
            f"joint `{name}`",
        )
        return {"lower": upper, "upper": lower}
    if lower == upper:
        raise DefinitionError(
            f"<limit> of joint `{name}` must have lower < upper; got {lower:g} and {upper:g}; "
            f"locked={{'{name}': {lower:g}}} holds a joint that does not move"
        )
    if lower > upper:
        raise DefinitionError(
            f"<limit> of joint `{name}` must have lower < upper; got {lower:g} and {upper:g}; correct it, hold the "
            f"joint by locked={{'{name}': POSITION}}, or use limits=False to read no limits"
        )
    return {"lower": lower, "upper": upper}


INERTIA = ("drake:rotor_inertia", "motorInertia", "rotorInertia")
RATIO = ("drake:gear_ratio", "mechanicalReduction")
"""`INERTIA` and `RATIO`: elements of a <transmission> with a rotor's inertia, kg m², and its gear ratio."""


def rotor_inertias(robot: ET.Element) -> dict[str, float]:
    """Return rotor inertias at the joints from transmissions, by joint name, kg m² or kg.

    An actuator's inertia I at the ratio r moves with its joint as r² I. A missing ratio is 1. A transmission
    without an inertia is ignored.

    - `robot`: outermost element.

    Raises DefinitionError if a number is invalid, or a transmission with an inertia does not have one joint.
    """
    rotors: dict[str, float] = {}
    for transmission in robot.findall("transmission"):
        name = transmission.get("name", "").strip()
        where = f"transmission `{name}`"
        inertia = _amount(where, transmission, INERTIA)
        if inertia is None:
            continue
        joints = [joint.get("name", "").strip() for joint in transmission.findall("joint")]
        if len(joints) != 1 or not joints[0] or len(transmission.findall("actuator")) > 1:
            raise DefinitionError(
                f"{where} has a rotor inertia, and couples several joints or actuators; remove it and give the "
                "inertias at the joints by `armature`"
            )
        ratio = _amount(where, transmission, RATIO)
        if inertia < 0.0 or ratio == 0.0:
            raise DefinitionError(
                f"{where} must have a rotor inertia >= 0 and a ratio other than 0; got {inertia:g} and {ratio or 0:g}"
            )
        rotors[joints[0]] = rotors.get(joints[0], 0.0) + inertia * (1.0 if ratio is None else ratio) ** 2
    return rotors


def _amount(where: str, transmission: ET.Element, names: tuple[str, ...]) -> float | None:
    """Return the number of the first element with one of the names: its attribute `value`, or its text. Else None."""
    for name in names:
        for element in transmission.iter(name):
            text = element.get("value", element.text or "").strip()
            return _numbers(where, name, "the value", text, 1)[0]
    return None


KINDS = ("revolute", "continuous", "prismatic", "fixed")
MOST_LINKS = 1000


@dataclass(frozen=True)
class UrdfTree:
    """The checked content of a file.

    - `links`, `joints`: elements by name.
    - `parents`, `children`: names of each joint's parent and child link, by the joint's name.
    - `carriers`: name of the joint that moves each link, by the link's name; the root has none.
    - `root`: name of the link that no joint moves.
    - `order`: names of the joints, each after its parent.
    """

    links: Mapping[str, ET.Element]
    joints: Mapping[str, ET.Element]
    parents: Mapping[str, str]
    children: Mapping[str, str]
    carriers: Mapping[str, str]
    root: str
    order: tuple[str, ...]

    @property
    def leaves(self) -> list[str]:
        """Names of the links that carry no other link."""
        carrying = set(self.parents.values())
        return [link for link in self.links if link not in carrying]

    def path_to(self, link: str) -> set[str]:
        """Return the names of the joints between the base and a link; the empty set for an unknown link."""
        joints: set[str] = set()
        while link in self.carriers:
            joints.add(self.carriers[link])
            link = self.parents[self.carriers[link]]
        return joints

    def moves(self, joint: str) -> bool:
        """True if a joint, given by its name, is not fixed."""
        return self.joints[joint].get("type") != "fixed"

    @cached_property
    def standing(self) -> set[str]:
        """Names of the links that do not move: the root, and all links fixed to it."""
        links = {self.root}
        for joint in self.order:
            if self.joints[joint].get("type") == "fixed" and self.parents[joint] in links:
                links.add(self.children[joint])
        return links


def urdf_tree(robot: ET.Element, notes: Notes | None = None) -> UrdfTree:
    """Return the links and joints of a file.

    - `robot`: its outermost element.
    - `notes`: receives the assumptions.

    Raises DefinitionError, naming link or joint, if an element is incomplete or they are not one tree.
    """
    notes = Notes() if notes is None else notes
    check_element("the robot", robot, notes)
    links, joints = _named(robot, "link", notes), _named(robot, "joint", notes)
    if not links:
        raise DefinitionError("the robot has no <link>")
    _add_base(links, joints, notes)
    if len(links) > MOST_LINKS:
        raise DefinitionError(f"the robot has {len(links)} links; at most {MOST_LINKS} are read")
    for name, link in links.items():
        check_element(f"link `{name}`", link, notes)
    parents: dict[str, str] = {}
    children: dict[str, str] = {}
    carriers: dict[str, str] = {}
    for name, joint in joints.items():
        check_element(f"joint `{name}`", joint, notes)
        _check_kind(name, joint)
        parents[name] = _link(name, joint, "parent", links)
        child = children[name] = _link(name, joint, "child", links)
        if child in carriers:
            raise DefinitionError(f"link `{child}` is the child of two joints, `{carriers[child]}` and `{name}`")
        carriers[child] = name
    root = _root(links, carriers)
    return UrdfTree(links, joints, parents, children, carriers, root, _order(root, links, parents, children))


def _add_base(links: dict[str, ET.Element], joints: Mapping[str, ET.Element], notes: Notes) -> None:
    """Add the base if no <link> describes it, only a joint names it, and all other links are children of joints.

    This occurs in files of parts that belong on another robot, and in files that rely on a link `world`.
    """
    ends = [{_end(joint, end) for joint in joints.values()} for end in ("parent", "child")]
    described = set(links) <= ends[1]
    missing = ends[0] - set(links) - {""}
    if not (described and len(missing) == 1 and not missing & ends[1]):
        return
    (base,) = missing
    links[base] = ET.Element("link", name=base)
    notes.add(
        f'link `{base}`, the parent of {{}}, is not described: it is taken as the base; write <link name="{base}"/>',
        next(f"joint `{name}`" for name, joint in joints.items() if _end(joint, "parent") == base),
    )


def _end(joint: ET.Element, end: str) -> str:
    element = joint.find(end)
    return element.get("link", "").strip() if element is not None else ""


def _named(robot: ET.Element, tag: str, notes: Notes) -> dict[str, ET.Element]:
    elements: dict[str, ET.Element] = {}
    for element in robot.findall(tag):
        name = element.get("name", "").strip()
        if not name:
            child = element.find("child")
            after = f" (it comes after `{list(elements)[-1]}`)" if elements else ""
            which = f" to link `{child.get('link')}`" if child is not None else after
            raise DefinitionError(f"a <{tag}>{which} has no name")
        if name in elements and same_element(elements[name], element):
            notes.add("{} occurs twice with the same values, and is read once; remove the second", f"{tag} `{name}`")
            continue
        if name in elements:
            raise DefinitionError(f"there are two <{tag}> named `{name}`; rename one")
        elements[name] = element
    return elements


def _check_kind(name: str, joint: ET.Element) -> None:
    kind = joint.get("type")
    if kind is None:
        raise DefinitionError(f"joint `{name}` has no type; the types are {', '.join(KINDS)}")
    if kind in ("floating", "planar", "spherical"):
        raise DefinitionError(
            f"joint `{name}` is {kind}; an arm stands on a fixed base and has only {', '.join(KINDS)} joints"
        )
    if kind not in KINDS:
        raise DefinitionError(f"joint `{name}` has the type `{kind}`; {nearest_word(kind.lower(), KINDS)}")


def _link(name: str, joint: ET.Element, end: str, links: Mapping[str, ET.Element]) -> str:
    link = _end(joint, end)
    if not link:
        raise DefinitionError(f'joint `{name}` has no <{end} link="...">')
    if link not in links:
        raise DefinitionError(
            f"the {end} of joint `{name}` is link `{link}`, which does not exist; {nearest_word(link, links)}"
        )
    return link


def _root(links: Mapping[str, ET.Element], carriers: Mapping[str, str]) -> str:
    roots = [link for link in links if link not in carriers]
    if not roots:
        raise DefinitionError(f"no link is the base: {_listed(list(links))} carry each other in a circle")
    if len(roots) > 1:
        raise DefinitionError(
            f"no joint carries the links {_listed(roots)}; one of them is the base, the others need a joint"
        )
    return roots[0]


def _order(
    root: str, links: Mapping[str, ET.Element], parents: Mapping[str, str], children: Mapping[str, str]
) -> tuple[str, ...]:
    """Return the joints in depth-first order from the root."""
    carried: dict[str, list[str]] = {link: [] for link in links}
    for joint, parent in parents.items():
        carried[parent].append(joint)
    order: list[str] = []
    left = carried[root][::-1]
    while left:
        joint = left.pop()
        order.append(joint)
        left.extend(reversed(carried[children[joint]]))
    if len(order) < len(parents):
        circle = [children[joint] for joint in parents if joint not in order]
        raise DefinitionError(f"the links {_listed(circle)} carry each other in a circle; none of them is on the base")
    return tuple(order)


def _listed(names: list[str]) -> str:
    shown = ", ".join(f"`{name}`" for name in names[:6])
    return shown if len(names) <= 6 else f"{shown} and {len(names) - 6} more"
