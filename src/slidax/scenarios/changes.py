"""Changes by dotted path, such as `start.q[elbow]`, before a scenario is validated."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter, ValidationError

from slidax.core.errors import DefinitionError, locate_errors, nearest_word, plain_name
from slidax.core.joint_names import match_names

from .schemes import PRESETS, owner_of, place_parameters, switch_scheme, with_kinds
from .uncertain_values import is_index
from .yaml_text import validation_error

BRACKETS = re.compile(r"\[([^\[\]]*)\]")


def without_brackets(path: str, joints: Sequence[str] = ()) -> str:
    """Return a path with dots instead of brackets: `start.q[2]` becomes `start.q.2`, `cost[0,1]` becomes `cost.0.1`.

    - `joints`: names of the robot's joints, which may be used as indices.

    Raises DefinitionError if an index is neither a number nor a joint's name.
    """
    rest = BRACKETS.sub("", path)
    if "[" in rest or "]" in rest or path.startswith("["):
        raise DefinitionError(f"`{plain_name(path)}` is not a path: write an entry of a list as NAME[0] or NAME[JOINT]")

    def dotted(match: re.Match[str]) -> str:
        words = match[1].strip()
        if re.fullmatch(r"\d+(\s*,\s*\d+)*", words):
            return "".join(f".{index.strip()}" for index in words.split(","))
        index = match_names(joints, [words]).get(words)
        if index is None:
            raise DefinitionError(
                f"`{plain_name(path)}`: `{plain_name(words)}` is not a joint of the robot, and not a number from 0 "
                f"to {len(joints) - 1}; {nearest_word(words, joints)}"
            )
        return f".{index}"

    return BRACKETS.sub(dotted, path)


def joint_names_in(data: Mapping[str, Any], folder: Path) -> tuple[str, ...]:
    """Return the joint names of a scenario's robot.

    - `data`: mapping of the scenario file.
    - `folder`: folder to which file names in it are relative.

    Raises DefinitionError if the robot is invalid.
    """
    with locate_errors("robot"):
        try:
            described = _robots().validate_python(data.get("robot"), context={"folder": folder})
        except ValidationError as error:
            raise validation_error(error, data.get("robot")) from None
        names: tuple[str, ...] = described.build().true.joint_names
    return names


@cache
def _robots() -> TypeAdapter[Any]:
    from .robots import RobotDescription

    return TypeAdapter(RobotDescription)


def with_changes(data: dict[str, Any], changes: dict[str, Any], folder: Path = Path()) -> dict[str, Any]:
    """Return a copy of a scenario's mapping with new values.

    In the result each parameter of the scheme is in the mapping of its part. For example, `scheme.k1` moves to
    `scheme.surface.k1` if only the surface has a k1.

    - `data`: mapping of the scenario file.
    - `changes`: new values by dotted path. Names and kinds are set first, since other values depend on them. Entries of
      lists, such as `start.q[0]`, are set last. A new `kind` drops the parameters of the old kind.
    - `folder`: folder to which file names in the scenario are relative.

    Raises DefinitionError if a path has an unknown index or goes through a single value. A new key is added; validation
    refuses unknown keys later.
    """
    data, changes = _with_lists(data), _with_lists(changes)
    if "scheme.name" in changes:
        data["scheme"] = switch_scheme(data.get("scheme"), changes.pop("scheme.name"))
    if isinstance(data.get("scheme"), dict):
        data["scheme"] = with_kinds(place_parameters(data["scheme"]))
    joints: tuple[str, ...] = ()
    for path, value in sorted(changes.items(), key=lambda change: (not change[0].endswith(".kind"), "[" in change[0])):
        if "[" in path and not joints:
            joints = joint_names_in(data, folder)
        _set(data, path_in(data, path, joints), _from_here(path, value), len(joints))
    if isinstance(data.get("scheme"), dict):
        data["scheme"] = place_parameters(data["scheme"])
    return data


def _with_lists(value: Any) -> Any:
    """A copy of the data with lists instead of tuples, so that entries can be set."""
    if isinstance(value, dict):
        return {key: _with_lists(part) for key, part in value.items()}
    return [_with_lists(part) for part in value] if isinstance(value, list | tuple) else value


def _from_here(path: str, value: Any) -> Any:
    """Make a file name in a change absolute: it is relative to the current folder, not to the scenario's."""
    return str(Path.cwd() / value) if path.endswith(".file") and isinstance(value, str) else value


def path_in(data: dict[str, Any], path: str, joints: Sequence[str] = ()) -> str:
    """Return the full path of a value: `start.q[elbow]` becomes `start.q.2`, `scheme.k1` becomes `scheme.surface.k1`.

    - `data`: mapping of the scenario file.
    - `path`: dotted path as in `--set`.
    - `joints`: names of the robot's joints, which may be used as indices.

    Raises DefinitionError if an index is neither a number nor a joint's name.
    """
    path = without_brackets(path, joints)
    parts = path.split(".")
    scheme = data.get("scheme")
    if parts[0] != "scheme" or len(parts) < 2 or not isinstance(scheme, dict):
        return path
    name = scheme.get("name")
    preset = PRESETS.get(name) if isinstance(name, str) else None
    owner = owner_of(preset, parts[1]) if preset is not None else None
    return ".".join(["scheme", *([owner] if owner else []), *parts[1:]])


def _set(data: dict[str, Any], path: str, value: Any, joints: int) -> None:
    parts = path.split(".")
    if not all(parts):
        raise DefinitionError(
            f"`{plain_name(path)}` is not a path: a name must be at its start, at its end and between two dots"
        )
    node: Any = data
    for depth, part in enumerate(parts):
        here = ".".join(parts[:depth]) or "the scenario"
        if isinstance(node, list):
            if not is_index(part) or int(part) >= len(node):
                raise DefinitionError(
                    f"`{here}` is a list of {len(node)}, and `{plain_name(part)}` is not an index from 0 to "
                    f"{len(node) - 1}. Write `{here}[0]`, or `{here}[JOINT]` if each entry belongs to a joint"
                )
            key: Any = int(part)
        elif isinstance(node, dict):
            key = part
        else:
            raise DefinitionError(f"`{plain_name(here)}` is a single value, so `{plain_name(path)}` cannot be set")
        if depth < len(parts) - 1 and is_index(parts[depth + 1]) and isinstance(node, dict):
            node[key] = _one_per_joint(node.get(key), ".".join(parts[: depth + 1]), joints)
        if depth == len(parts) - 1:
            if key == "kind" and isinstance(node, dict) and node.get("kind", value) != value:
                node.clear()
            node[key] = value
        else:
            node = node.setdefault(key, {}) if isinstance(node, dict) else node[key]


def _one_per_joint(value: Any, path: str, joints: int) -> Any:
    """Expand a number to a list with an entry for each joint, so that an entry can be set."""
    if value is None:
        raise DefinitionError(
            f"`{plain_name(path)}` is not in the file, so a single entry of it cannot be set: set all entries"
        )
    spread = joints and isinstance(value, int | float) and not isinstance(value, bool)
    return [value] * joints if spread else value
