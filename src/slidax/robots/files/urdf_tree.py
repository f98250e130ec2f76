"""Links and joints of a URDF file as one tree."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

from slidax._errors import DefinitionError, nearest

from .notes import Notes
from .urdf_values import check, same

KINDS = ("revolute", "continuous", "prismatic", "fixed")
MOST_LINKS = 1000


@dataclass(frozen=True)
class Tree:
    """The checked content of a file.

    - `links`, `joints`: elements by name.
    - `parents`, `children`: names of each joint's links.
    - `carriers`: name of the joint that moves each link; the root has none.
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
        """Links that carry no other."""
        carrying = set(self.parents.values())
        return [link for link in self.links if link not in carrying]

    def path_to(self, link: str) -> set[str]:
        """Return the joints between the base and a link; the empty set for an unknown link."""
        joints: set[str] = set()
        while link in self.carriers:
            joints.add(self.carriers[link])
            link = self.parents[self.carriers[link]]
        return joints

    def moves(self, joint: str) -> bool:
        """True if a joint is not fixed."""
        return self.joints[joint].get("type") != "fixed"

    @cached_property
    def standing(self) -> set[str]:
        """Links that do not move: the root, and all links fixed to it."""
        links = {self.root}
        for joint in self.order:
            if self.joints[joint].get("type") == "fixed" and self.parents[joint] in links:
                links.add(self.children[joint])
        return links


def tree_of(robot: ET.Element, notes: Notes | None = None) -> Tree:
    """Return the links and joints of a file.

    - `robot`: its outermost element.
    - `notes`: receives the assumptions.

    Raises DefinitionError, naming link or joint, if an element is incomplete or they are not one tree.
    """
    notes = Notes() if notes is None else notes
    check("the robot", robot, notes)
    links, joints = _named(robot, "link", notes), _named(robot, "joint", notes)
    if not links:
        raise DefinitionError("the robot has no <link>")
    _add_base(links, joints, notes)
    if len(links) > MOST_LINKS:
        raise DefinitionError(f"the robot has {len(links)} links; at most {MOST_LINKS} are read")
    for name, link in links.items():
        check(f"link `{name}`", link, notes)
    parents: dict[str, str] = {}
    children: dict[str, str] = {}
    carriers: dict[str, str] = {}
    for name, joint in joints.items():
        check(f"joint `{name}`", joint, notes)
        _check_kind(name, joint)
        parents[name] = _link(name, joint, "parent", links)
        child = children[name] = _link(name, joint, "child", links)
        if child in carriers:
            raise DefinitionError(f"link `{child}` is the child of two joints, `{carriers[child]}` and `{name}`")
        carriers[child] = name
    root = _root(links, carriers)
    return Tree(links, joints, parents, children, carriers, root, _order(root, links, parents, children))


def _add_base(links: dict[str, ET.Element], joints: Mapping[str, ET.Element], notes: Notes) -> None:
    """Take a named link without description as the base, if a joint carries every described link.

    Parts that are meant to be fixed to another robot are like this, and files that rely on a link `world`.
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
        if name in elements and same(elements[name], element):
            notes.add("{} is there twice, with the same values, and is read once; remove the second", f"{tag} `{name}`")
            continue
        if name in elements:
            raise DefinitionError(f"there are two <{tag}> named `{name}`; give one another name")
        elements[name] = element
    return elements


def _check_kind(name: str, joint: ET.Element) -> None:
    kind = joint.get("type")
    if kind is None:
        raise DefinitionError(f"joint `{name}` has no type; there are {', '.join(KINDS)}")
    if kind in ("floating", "planar", "spherical"):
        raise DefinitionError(
            f"joint `{name}` is {kind}; an arm stands on a fixed base and has only {', '.join(KINDS)} joints"
        )
    if kind not in KINDS:
        raise DefinitionError(f"joint `{name}` has the type `{kind}`; {nearest(kind.lower(), KINDS)}")


def _link(name: str, joint: ET.Element, end: str, links: Mapping[str, ET.Element]) -> str:
    link = _end(joint, end)
    if not link:
        raise DefinitionError(f'joint `{name}` has no <{end} link="...">')
    if link not in links:
        raise DefinitionError(
            f"the {end} of joint `{name}` is link `{link}`, which does not exist; {nearest(link, links)}"
        )
    return link


def _root(links: Mapping[str, ET.Element], carriers: Mapping[str, str]) -> str:
    roots = [link for link in links if link not in carriers]
    if not roots:
        raise DefinitionError(f"no link is the base: {_listed(list(links))} carry each other in a circle")
    if len(roots) > 1:
        raise DefinitionError(
            f"the links {_listed(roots)} are all without a joint that carries them; one of them is the base, the "
            f"others need a joint"
        )
    return roots[0]


def _order(
    root: str, links: Mapping[str, ET.Element], parents: Mapping[str, str], children: Mapping[str, str]
) -> tuple[str, ...]:
    """Joints in depth-first order from the root."""
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
