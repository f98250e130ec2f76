"""A file with the description of a robot, as an identification writes it, and the messages of robot files."""

from __future__ import annotations

import re
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from slidax._errors import DefinitionError

from .yaml_text import read_yaml_file

ARGUMENT = re.compile(r"\b(tip|locked|limits|meshes|inertias|mimics)=(\"\w+\"|\{[^{}]*\}|\w+)")
"""Arguments of the readers of robot files that a message may name as its remedy."""


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


@contextmanager
def messages_with_keys() -> Iterator[None]:
    """Put errors and warnings of a reader of robot files into the words of a scenario file.

    An argument that one names as its remedy becomes a key: `mimics="followed"` is `mimics: followed`.
    """
    with warnings.catch_warnings(record=True) as assumed:
        warnings.simplefilter("always")
        try:
            yield
        except DefinitionError as error:
            # The file's own path is no part of the path in a scenario.
            where = "file" if error.where else ""
            raise DefinitionError(_as_keys(str(error)), where=where).offering(error.setting) from error
    for one in assumed:
        warnings.warn(_as_keys(str(one.message)), one.category, stacklevel=4)


def _as_keys(text: str) -> str:
    text = re.sub(r"\bpackages=\{[^{}]*\}", "packages: [FOLDER]", text)
    return ARGUMENT.sub(lambda found: f"{found[1]}: {found[2].strip(chr(34))}", text)
