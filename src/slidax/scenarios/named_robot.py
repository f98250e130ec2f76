"""A robot by one word: a name, or a file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from pydantic import TypeAdapter

from slidax._errors import DefinitionError, nearest, plain
from slidax.robots import Articulated, ready

from .robot_file import read_robot
from .robots import RobotDescription
from .true_and_nominal import AbstractArticulated

FILES = {".urdf": "urdf", ".xml": "mjcf", ".mjcf": "mjcf", ".yaml": "identified", ".yml": "identified"}
"""Kinds of descriptions by the ending of a file."""


def named_robot(word: str, *, tip: str | None = None) -> tuple[Articulated, dict[str, Any]]:
    """The nominal arm, and its description as a scenario file has it under `robot`.

    - `word`: a ready arm by its name; or a URDF file, an MJCF file, or a YAML file with a mapping `robot`.
    - `tip`: the link, body or site of the tip; for URDF and MJCF files with more than one end.

    Raises DefinitionError if there is no such arm.
    """
    kind = FILES.get(Path(word).suffix.lower())
    if kind is None and word not in ready.names():
        raise DefinitionError(
            f"unknown robot `{plain(word)}`; {nearest(word, ready.names())} (a file ends in {', '.join(FILES)})"
        )
    if tip is not None and kind not in ("urdf", "mjcf"):
        raise DefinitionError("a tip is chosen for URDF and MJCF files alone; write it into the description otherwise")
    if kind == "identified":
        # Written out, so that what is found can take the place of what is there.
        description, folder = read_robot(word)
        description = {key: value for key, value in description.items() if key != "plant"}
        if "file" in description:
            description["file"] = str(folder / description["file"])
    else:
        description = {"kind": kind or word} | ({"file": word} if kind else {}) | ({"tip": tip} if tip else {})
    found = TypeAdapter(RobotDescription).validate_python(description)
    if not isinstance(found, AbstractArticulated):
        raise DefinitionError(f"`{plain(word)}` must be an arm of rigid links; got {found.kind}")
    robot = found.build().nominal
    assert isinstance(robot, Articulated)
    return robot, description
