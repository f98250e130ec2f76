"""A robot from the name of a built-in arm or of a file."""

from __future__ import annotations

import re
import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import TypeAdapter, ValidationError

from slidax.arms.articulated import Articulated
from slidax.arms.built_in import built_in_names
from slidax.arms.coupled import Coupled
from slidax.arms.files.robot_descriptions import description_file, is_description
from slidax.core.errors import DefinitionError, nearest_word, plain_name, short_repr

from .robots import AbstractArticulated, RobotDescription, read_robot
from .yaml_text import validation_error

FILES = {
    ".urdf": "urdf",
    ".xacro": "urdf",
    ".xml": "mjcf",
    ".mjcf": "mjcf",
    ".yaml": "identified",
    ".yml": "identified",
}
"""Kinds of descriptions by file extension."""


def named_robot(
    word: str,
    *,
    tip: str | None = None,
    inertias: str | None = None,
    locked: Mapping[str, float] | None = None,
    gravity: Sequence[float] | None = None,
) -> tuple[Articulated, dict[str, Any]]:
    """Return the nominal arm, and its description as under `robot` in a scenario file.

    - `word`: name of a built-in arm, or of a module of robot_descriptions; or a URDF file, an MJCF file, or a YAML file
      with a mapping `robot`.
    - `tip`: link, body or site of the tip, for URDF and MJCF files with several ends.
    - `inertias`: `nearest` replaces inertias that no rigid body can have, `strict` refuses them; None: as the
      description has it, or `given`, which replaces those with small errors.
    - `locked`: joints in a file that do not move, with their positions [rad or m].
    - `gravity`: gravity in the base frame [3], m/s²; by default that of the description.

    Raises DefinitionError if the arm does not exist, its description is invalid, or an option does not apply to it.
    """
    if is_description(word):
        word = str(description_file(word))
    kind = FILES.get(Path(word).suffix.lower())
    if kind is None and word not in built_in_names():
        raise DefinitionError(
            f"unknown robot `{plain_name(word)}`; {nearest_word(word, built_in_names())} "
            f"(the name of a robot file ends in {', '.join(FILES)})"
        )
    if tip is not None and kind not in ("urdf", "mjcf"):
        raise DefinitionError("`tip` is only for URDF and MJCF files; otherwise write it into the arm's description")
    description: dict[str, Any]
    if kind == "identified":
        # Use the mapping itself, so that estimates can replace its values.
        written, folder = read_robot(word)
        description = {key: value for key, value in written.items() if key != "plant"}
        if "file" in description:
            if not isinstance(description["file"], str):
                message = f"must be the name of a file; got {short_repr(description['file'])}"
                raise DefinitionError(message, where="robot.file")
            description["file"] = str(folder / description["file"])
    else:
        description = {"kind": kind or word, **({"file": word} if kind else {}), **({"tip": tip} if tip else {})}
    held = {**_mapping(description, "locked"), **locked} if locked else None
    for field, value in {"inertias": inertias, "locked": held}.items():
        if value:
            if description["kind"] not in ("urdf", "mjcf"):
                raise DefinitionError(
                    f"`--{field}` is only for URDF and MJCF files; `{plain_name(word)}` is neither: leave it out"
                )
            description[field] = value
    if gravity is not None:
        description["nominal"] = _mapping(description, "nominal") | {"gravity": list(gravity)}
    try:
        with warnings.catch_warnings(record=True) as assumed:
            warnings.simplefilter("always")
            robot = _built(word, description)
    except DefinitionError as error:
        # The readers' messages name remedies in Python or YAML; here, name the command's options instead.
        option = error.setting and f"`{error.setting.as_option}`"
        reworded = error.reworded(option) if option else error
        raise DefinitionError(_with_options(reworded.message), where=error.where) from None
    for warning in assumed:
        warnings.warn(_with_options(str(warning.message)), warning.category, stacklevel=2)
    return robot, description


def _mapping(description: Mapping[str, Any], field: str) -> dict[str, Any]:
    """Return the mapping in a field of a description; empty if the description has no such field."""
    value = description.get(field, {})
    if not isinstance(value, dict):
        raise DefinitionError(f"must be a mapping; got {short_repr(value)}", where=f"robot.{field}")
    return value


def _with_options(message: str) -> str:
    """Return a message in which command-line options replace `locked={...}` and `inertias: strict`."""
    message = re.sub(
        r"locked=\{([^}]*)\}",
        lambda match: " ".join(
            f"--locked {name}={position}" for name, position in re.findall(r"'([^']+)': ([^,]+)", match[1])
        ),
        message,
    )
    return re.sub(r"\binertias: (strict|nearest)\b", r"`--inertias \1`", message)


def _built(word: str, description: Mapping[str, Any]) -> Articulated:
    try:
        validated = TypeAdapter(RobotDescription).validate_python(description)
    except ValidationError as error:
        raise validation_error(error, dict(description)) from None
    if not isinstance(validated, AbstractArticulated):
        raise DefinitionError(f"`{plain_name(word)}` must be an arm of rigid links; got {validated.kind}")
    robot = validated.build().nominal
    if isinstance(robot, Coupled):
        lower, upper = np.asarray(robot.arm.limits.lower), np.asarray(robot.arm.limits.upper)
        nearest = dict(zip(robot.arm.joint_names, np.clip(0.0, lower, upper).tolist(), strict=True))
        held = ", ".join(f"'{name}': {nearest[name]:g}" for name in robot.followers)
        raise DefinitionError(
            f"`{plain_name(word)}` has joints that follow others, which identification does not support; "
            f"locked={{{held}}} holds them, if they have these positions in the log"
        )
    assert isinstance(robot, Articulated)
    return robot
