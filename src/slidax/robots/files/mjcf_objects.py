"""Objects of a scene that are not part of the arm."""

from __future__ import annotations

from typing import Any

from .loader import mujoco


def leave_out_objects(spec: Any, tip: str | None) -> list[str]:
    """Delete bodies that are not part of the arm, and return their names.

    The bodies of the world are trees. With a tip, all moving trees without it are objects. Without one, trees with a
    free or a ball joint are objects, if another tree can be an arm. A body that an equality ties is no object.

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
