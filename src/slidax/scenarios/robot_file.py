"""A file with the description of a robot, as an identification writes it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from slidax._errors import DefinitionError

from .yaml_text import read_yaml_file


def read_robot(path: str | Path) -> tuple[dict[str, Any], Path]:
    """The mapping `robot` in a YAML file, and the folder from which files that it names are found.

    - `path`: of the file.

    Raises DefinitionError if it cannot be read or has no such mapping.
    """
    path = Path(path)
    data = read_yaml_file(path)
    robot = data.get("robot") if isinstance(data, dict) else None
    if not isinstance(robot, dict) or not isinstance(robot.get("kind"), str):
        raise DefinitionError(f"the file `{path}` has no mapping `robot` with a `kind`")
    if robot["kind"] == "identified":
        raise DefinitionError(f"the robot of the file `{path}` must be described there, and not in one more file")
    return robot, path.parent
