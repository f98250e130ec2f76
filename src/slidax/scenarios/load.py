"""From a file to a scenario, with errors that a person can act on."""

from __future__ import annotations

from importlib import resources
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from slidax._errors import DefinitionError, nearest, plain

from .changes import changed
from .description import ScenarioDescription
from .mistakes import translated
from .scenario import Scenario
from .yaml_text import read_yaml, require_readable, text_of

BUILT_IN = resources.files("slidax.scenarios") / "built_in"


def names() -> list[str]:
    """The names of the built-in scenarios."""
    return sorted(Path(entry.name).stem for entry in BUILT_IN.iterdir() if entry.name.endswith(".yaml"))


def load(scenario: str | Path, changes: dict[str, Any] | None = None) -> Scenario:
    """A scenario, built.

    - `scenario`: name of a built-in scenario, or path of a YAML file.
    - `changes`: values by dotted path, such as `{"disturbance.scale": 0.0}` or `{"start.q[elbow]": 0.3}`, set before
      validation; a place in a list is a joint's name or a number from 0. `scheme.name` comes
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
    return altered_description(scenario.description, changes).build(scenario.name)


def altered_description(description: ScenarioDescription, changes: dict[str, Any]) -> ScenarioDescription:
    """The same description with other values.

    - `description`: what a scenario file says.
    - `changes`: values by dotted path, as in `load`.

    Raises DefinitionError if something is invalid then.
    """
    return validated(description.model_dump(exclude_unset=True), changes)


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


def validated(
    data: Any,
    changes: dict[str, Any] | None = None,
    *,
    folder: Path = Path(),
    form: type[ScenarioDescription] = ScenarioDescription,
) -> ScenarioDescription:
    """The validated description in what a YAML text became.

    - `data`: mappings, lists and values.
    - `changes`, `folder`: as in `parse`.
    - `form`: what it describes, where that has other schemes.

    Raises DefinitionError with the path of the first field that is wrong.
    """
    if not isinstance(data, dict):
        raise DefinitionError("a scenario is a mapping with the keys " + ", ".join(ScenarioDescription.model_fields))
    require_readable(data)
    data = changed(data, changes or {}, folder)
    try:
        found = form.model_validate(data, context={"folder": folder})
    except ValidationError as error:
        raise translated(error, data) from None
    found.as_it_is()
    return found


def _folder(scenario: str | Path) -> Path:
    return Path(scenario).parent if Path(scenario).suffix in (".yaml", ".yml") else Path()


def _read(scenario: str | Path) -> tuple[str, str]:
    path = Path(scenario)
    if path.suffix in (".yaml", ".yml"):
        return path.stem, text_of(path, "the scenario file")
    if str(scenario) not in names():
        raise DefinitionError(
            f"unknown scenario `{plain(scenario)}`; {nearest(str(scenario), names())} (a file needs the ending .yaml)"
        )
    return str(scenario), (BUILT_IN / f"{scenario}.yaml").read_text(encoding="utf-8")
