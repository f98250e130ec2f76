"""From a file to a scenario, with errors that a person can act on."""

from __future__ import annotations

from importlib import resources
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from slidax._errors import DefinitionError, nearest, plain, shown

from .changes import changed
from .description import ScenarioDescription
from .scenario import Scenario
from .yaml_text import read_yaml, require_readable

LIMITS = {
    "greater_than": (">", "gt"),
    "greater_than_equal": (">=", "ge"),
    "less_than": ("<", "lt"),
    "less_than_equal": ("<=", "le"),
}
"""Kinds of mistakes about a number's range: the sign, and the key under which pydantic has the limit."""

BUILT_IN = resources.files("slidax.scenarios") / "built_in"


def names() -> list[str]:
    """The names of the built-in scenarios."""
    return sorted(Path(entry.name).stem for entry in BUILT_IN.iterdir() if entry.name.endswith(".yaml"))


def load(scenario: str | Path, changes: dict[str, Any] | None = None) -> Scenario:
    """A scenario, built.

    - `scenario`: name of a built-in scenario, or path of a YAML file.
    - `changes`: values by dotted path, such as `{"disturbance.scale": 0.0}`, set before validation. `scheme.name` comes
      first and puts another scheme in place of the file's, of which the envelope, the bound and `sampled_data` remain.
      Files that are named here are found from the current folder.

    Raises DefinitionError if there is no such scenario, or something in it is invalid.
    """
    name, text = _read(scenario)
    return parse(text, changes, folder=_folder(scenario)).build(name)


def altered(scenario: Scenario, changes: dict[str, Any]) -> Scenario:
    """The same scenario with other values, as `load` would have built it.

    - `scenario`: one that was loaded; what `replace` changed in it is not kept.
    - `changes`: values by dotted path, as in `load`.

    Raises DefinitionError if something is invalid then.
    """
    return validated(scenario.description.model_dump(exclude_unset=True), changes).build(scenario.name)


def described(scenario: str | Path) -> ScenarioDescription:
    """What a scenario file says, validated but not built, which takes longer.

    - `scenario`: name of a built-in scenario, or path of a YAML file.

    Raises DefinitionError if there is no such scenario, or something in it is invalid.
    """
    return parse(_read(scenario)[1], folder=_folder(scenario))


def parse(text: str, changes: dict[str, Any] | None = None, *, folder: Path = Path()) -> ScenarioDescription:
    """The validated description in a YAML text.

    - `text`: YAML.
    - `changes`: values by dotted path, set before validation, as in `load`.
    - `folder`: from where files that it names are found.

    Raises DefinitionError with the path of the first field that is wrong.
    """
    return validated(read_yaml(text), changes, folder=folder)


def validated(data: Any, changes: dict[str, Any] | None = None, *, folder: Path = Path()) -> ScenarioDescription:
    """The validated description in what a YAML text became.

    - `data`: mappings, lists and values.
    - `changes`, `folder`: as in `parse`.

    Raises DefinitionError with the path of the first field that is wrong.
    """
    if not isinstance(data, dict):
        raise DefinitionError("a scenario is a mapping with the keys " + ", ".join(ScenarioDescription.model_fields))
    require_readable(data)
    data = changed(data, changes or {})
    try:
        return ScenarioDescription.model_validate(data, context={"folder": folder})
    except ValidationError as error:
        raise _translated(error, data) from None


def _folder(scenario: str | Path) -> Path:
    return Path(scenario).parent if Path(scenario).suffix in (".yaml", ".yml") else Path()


def _read(scenario: str | Path) -> tuple[str, str]:
    path = Path(scenario)
    if path.suffix in (".yaml", ".yml"):
        try:
            return path.stem, path.read_text(encoding="utf-8")
        except (OSError, UnicodeDecodeError) as error:
            reason = getattr(error, "strerror", None) or "it is not UTF-8 text"
            raise DefinitionError(f"cannot read the scenario file `{path}`: {reason}") from None
    if str(scenario) not in names():
        raise DefinitionError(
            f"unknown scenario `{plain(scenario)}`; {nearest(str(scenario), names())} (a file needs the ending .yaml)"
        )
    return str(scenario), (BUILT_IN / f"{scenario}.yaml").read_text(encoding="utf-8")


def _translated(error: ValidationError, data: Any) -> DefinitionError:
    """The first mistake as one sentence: what pydantic says is for programmers."""
    mistakes = error.errors(include_url=False)
    first = mistakes[0]
    where = _path(first, data)
    together = [mistake for mistake in mistakes if _path(mistake, data) == where]
    kinds = {mistake["type"] for mistake in together}
    context = first.get("ctx", {})
    given = first.get("input")
    if first["type"] == "missing":
        message = "is missing"
    elif first["type"] == "union_tag_not_found":
        message = f"needs a {context['discriminator']}, one of the known kinds"
    elif first["type"] == "union_tag_invalid":
        known = [word.strip().strip("'") for word in context["expected_tags"].split(",")]
        where = f"{where}.{context['discriminator'].strip(chr(39))}"
        message = f"unknown `{plain(context['tag'])}`; {nearest(str(context['tag']), known)}"
    elif first["type"] == "literal_error":
        known = [word.strip().strip("'") for word in context["expected"].replace(" or ", ",").split(",")]
        message = f"unknown `{plain(given)}`; {nearest(str(given), known)}"
    elif "list_type" in kinds and kinds & {"float_type", "float_parsing"}:
        message = f"must be a number or a list of numbers; got {shown(given)}"
    elif first["type"] in ("float_type", "float_parsing"):
        message = f"must be a number; got {shown(given)}"
    elif first["type"] == "list_type":
        message = f"must be a list; got {shown(given)}"
    elif first["type"] in LIMITS:
        sign, limit = LIMITS[first["type"]]
        message = f"must be {sign} {context[limit]:g}; got {shown(given)}"
    elif first["type"] in ("too_short", "too_long"):
        sign, limit = (">=", "min_length") if first["type"] == "too_short" else ("<=", "max_length")
        message = f"must have {sign} {context[limit]} entries; got {shown(given)}"
    elif first["type"] == "unknown_key":
        message = first["msg"]
    else:
        message = f"{first['msg'][0].lower()}{first['msg'][1:]}; got {shown(given)}"
    return DefinitionError(message, where=where)


def _path(mistake: Any, data: Any) -> str:
    """The path as written in the file: pydantic puts the names of union members between the keys."""
    loc: tuple[int | str, ...] = mistake["loc"]
    absent = len(loc) - 1 if mistake["type"] == "missing" else -1
    parts: list[str] = []
    place = data
    for depth, part in enumerate(loc):
        if isinstance(place, dict) and (part in place or depth == absent):
            place = place.get(part)
            parts.append(str(part))
        elif isinstance(place, list) and isinstance(part, int) and part < len(place):
            place = place[part]
            parts.append(str(part))
    return ".".join(parts)
