"""Values that are set in a scenario file before it is validated."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from slidax._errors import DefinitionError, plain

from .schemes import PRESETS, owner_of, placed, renamed, switched, with_kinds


def changed(data: dict[str, Any], changes: dict[str, Any]) -> dict[str, Any]:
    """A scenario with other values, each number of its scheme under the part that has it.

    - `data`: the mapping in the file, which stays as it is.
    - `changes`: values by dotted path. Names and kinds come first: what else is set belongs to what they name. A `kind`
      that is not the file's own drops what the file says of the other one.

    Raises DefinitionError if a path leads nowhere.
    """
    data, changes = _with_lists(data), dict(changes)
    if "scheme.name" in changes:
        data["scheme"] = switched(data.get("scheme"), changes.pop("scheme.name"))
    if isinstance(data.get("scheme"), dict):
        data["scheme"] = with_kinds(placed(data["scheme"]))
    for path, value in sorted(changes.items(), key=lambda change: not change[0].endswith(".kind")):
        _set(data, path_in(data, path), _found_from_here(path, value))
    if isinstance(data.get("scheme"), dict):
        data["scheme"] = placed(data["scheme"])
    return data


def _with_lists(value: Any) -> Any:
    """What a description was made of has tuples, whose entries could not be set."""
    if isinstance(value, dict):
        return {key: _with_lists(part) for key, part in value.items()}
    return [_with_lists(part) for part in value] if isinstance(value, list | tuple) else value


def _found_from_here(path: str, value: Any) -> Any:
    """A file that is named in a change is found from the current folder, whichever the scenario's is."""
    return str(Path.cwd() / value) if path.endswith(".file") and isinstance(value, str) else value


def path_in(data: dict[str, Any], path: str) -> str:
    """The path of a number of the scheme with the part that has it; any other as it is.

    - `data`: the mapping in the file.
    - `path`: as of `--set`.
    """
    parts = path.split(".")
    scheme = data.get("scheme")
    if parts[0] != "scheme" or len(parts) < 2 or not isinstance(scheme, dict):
        return path
    name = scheme.get("name")
    preset = PRESETS.get(name) if isinstance(name, str) else None
    owner = owner_of(preset, parts[1]) if preset is not None else None
    return ".".join(renamed(["scheme", *([owner] if owner else []), *parts[1:]]))


def _set(data: dict[str, Any], path: str, value: Any) -> None:
    parts = path.split(".")
    if not all(parts):
        raise DefinitionError(f"`{plain(path)}` is no path: it needs a name between any two dots, and at its ends")
    place: Any = data
    for depth, part in enumerate(parts):
        here = ".".join(parts[:depth]) or "the scenario"
        if isinstance(place, list):
            if not (part.isascii() and part.isdigit() and len(part) < 10) or int(part) >= len(place):
                raise DefinitionError(
                    f"`{here}` is a list of {len(place)}; `{plain(part)}` is not one of its numbers from 0"
                )
            key: Any = int(part)
        elif isinstance(place, dict):
            key = part
        else:
            raise DefinitionError(f"`{plain(here)}` is a single value, so `{plain(path)}` cannot be set")
        if depth == len(parts) - 1:
            if key == "kind" and isinstance(place, dict) and place.get("kind", value) != value:
                place.clear()
            place[key] = value
        else:
            place = place.setdefault(key, {}) if isinstance(place, dict) else place[key]
