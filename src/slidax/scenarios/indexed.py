"""Paths with indices in brackets, such as `start.q[2]` and `start.q[elbow]`."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter, ValidationError

from slidax._errors import DefinitionError, located, nearest, plain
from slidax._names import matched

from .mistakes import translated

BRACKETS = re.compile(r"\[([^\[\]]*)\]")


def without_brackets(path: str, joints: Sequence[str] = ()) -> str:
    """Return a path with its indices after dots: `start.q[2]` is `start.q.2`, `cost[0,1]` is `cost.0.1`.

    - `joints`: names of the robot's joints, which may be indices.

    Raises DefinitionError if an index is no joint's name.
    """
    whole = BRACKETS.sub("", path)
    if "[" in whole or "]" in whole or path.startswith("["):
        raise DefinitionError(f"`{plain(path)}` is no path: a place in a list has the form NAME[0] or NAME[JOINT]")

    def dotted(match: re.Match[str]) -> str:
        words = match[1].strip()
        if re.fullmatch(r"\d+(\s*,\s*\d+)*", words):
            return "".join(f".{place.strip()}" for place in words.split(","))
        place = matched(joints, [words]).get(words)
        if place is None:
            raise DefinitionError(
                f"`{plain(path)}`: `{plain(words)}` is no joint of the robot, and no number from 0 "
                f"to {len(joints) - 1}; {nearest(words, joints)}"
            )
        return f".{place}"

    return BRACKETS.sub(dotted, path)


def joint_names_in(data: Mapping[str, Any], folder: Path) -> tuple[str, ...]:
    """Return the joint names of a scenario's robot.

    - `data`: mapping of the file.
    - `folder`: folder of the files that it names.

    Raises DefinitionError if the robot is invalid.
    """
    with located("robot"):
        try:
            described = _robots().validate_python(data.get("robot"), context={"folder": folder})
        except ValidationError as error:
            raise translated(error, data.get("robot")) from None
        names: tuple[str, ...] = described.build().true.joint_names
    return names


@cache
def _robots() -> TypeAdapter[Any]:
    from .robots import RobotDescription

    return TypeAdapter(RobotDescription)
