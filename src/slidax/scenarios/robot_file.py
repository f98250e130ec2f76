"""Read a file with the description of a robot, and reword messages about robot files for scenarios."""

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
"""Arguments of the readers of robot files that messages name as remedies."""


def read_robot(path: str | Path) -> tuple[dict[str, Any], Path]:
    """Return the mapping `robot` in a YAML file, and the folder of the files that it names.

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
    """Reword errors and warnings of a reader of robot files for scenario files.

    Arguments in remedies become keys: `mimics="followed"` is `mimics: followed`.
    """
    with warnings.catch_warnings(record=True) as assumed:
        warnings.simplefilter("always")
        try:
            yield
        except DefinitionError as error:
            # A path inside the robot file is no path in the scenario.
            where = "file" if error.where else ""
            raise DefinitionError(_as_keys(str(error)), where=where).offering(error.setting) from error
    for warning in assumed:
        warnings.warn(_as_keys(str(warning.message)), warning.category, stacklevel=4)


def _as_keys(text: str) -> str:
    text = re.sub(r"\bpackages=\{[^{}]*\}", "packages: [FOLDER]", text)
    return ARGUMENT.sub(lambda match: f"{match[1]}: {match[2].strip(chr(34))}", text)
