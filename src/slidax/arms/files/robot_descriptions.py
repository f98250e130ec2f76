"""Find robot files by their names in the Python package robot_descriptions, such as `panda_description`."""

from __future__ import annotations

import re
from importlib import import_module
from pathlib import Path

from slidax.core.errors import DefinitionError

NAME = re.compile(r"\w+_description", re.ASCII)

PATHS = ("URDF_PATH", "MJCF_PATH", "XACRO_PATH")
"""Variables of a module that hold the path of its robot file, in the order of preference."""


def is_description(word: str) -> bool:
    """True if a word has the form of the name of a module of robot_descriptions."""
    return NAME.fullmatch(word) is not None


def description_file(name: str) -> Path:
    """Return the robot file of a module; the package downloads the robot's repository unless its cache has it.

    - `name`: name of the module.

    Raises DefinitionError if the package is not installed, has no such module, or the download fails.
    """
    try:
        import_module("robot_descriptions")
    except ModuleNotFoundError:
        raise DefinitionError(
            f"`{name}` is a robot of robot_descriptions, which is needed: pip install robot_descriptions"
        ) from None
    try:
        module = import_module(f"robot_descriptions.{name}")
    except ModuleNotFoundError:
        raise DefinitionError(
            f"`{name}` is not a robot of robot_descriptions; `python -m robot_descriptions list` lists them"
        ) from None
    except Exception as error:
        # The import runs git, whose failures have no common class.
        raise DefinitionError(f"robot_descriptions does not provide `{name}`: {error}") from error
    for variable in PATHS:
        if hasattr(module, variable):
            return Path(getattr(module, variable))
    raise DefinitionError(f"`{name}` of robot_descriptions has no URDF, MJCF or xacro file")
