"""Read scenarios from files."""

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
    """Return the names of the built-in scenarios."""
    return sorted(Path(entry.name).stem for entry in BUILT_IN.iterdir() if entry.name.endswith(".yaml"))


def load(scenario: str | Path, changes: dict[str, Any] | None = None) -> Scenario:
    """Read and build a scenario.

    - `scenario`: name of a built-in scenario, or path of a YAML file.
    - `changes`: values by dotted path, such as `{"disturbance.scale": 0.0}` or `{"start.q[elbow]": 0.3}`, set before
      validation; an index is a joint's name or a number from 0. `scheme.name` comes first and selects another scheme,
      which keeps the envelope, the bound and `sampled_data` of the file. File paths in changes are relative to the
      current folder.

    Raises DefinitionError if the scenario does not exist or is invalid.
    """
    name, text = _read(scenario)
    return parse(text, changes, folder=_folder(scenario)).build(name)


def altered(scenario: Scenario, changes: dict[str, Any]) -> Scenario:
    """Return a loaded scenario with other values by dotted path, as `load` would have built it.

    Changes by `replace` are lost.

    Raises DefinitionError if a value is invalid.
    """
    return altered_description(scenario.description, changes).build(scenario.name)


def altered_description(description: ScenarioDescription, changes: dict[str, Any]) -> ScenarioDescription:
    """Return a description with other values by dotted path, as in `load`.

    Raises DefinitionError if a value is invalid.
    """
    return validated(description.model_dump(exclude_unset=True), changes)


def described(scenario: str | Path) -> ScenarioDescription:
    """Read the validated description of a scenario without building it.

    - `scenario`: name of a built-in scenario, or path of a YAML file.

    Raises DefinitionError if the scenario does not exist or is invalid.
    """
    return parse(_read(scenario)[1], folder=_folder(scenario))


def parse(text: str, changes: dict[str, Any] | None = None, *, folder: Path = Path()) -> ScenarioDescription:
    """Return the validated description in a YAML text.

    - `changes`: values by dotted path, set before validation, as in `load`.
    - `folder`: folder of the files that it names.

    Raises DefinitionError with the path of the first invalid field.
    """
    return validated(read_yaml(text), changes, folder=folder)


def validated(
    data: Any,
    changes: dict[str, Any] | None = None,
    *,
    folder: Path = Path(),
    form: type[ScenarioDescription] = ScenarioDescription,
) -> ScenarioDescription:
    """Return the validated description in data from a YAML text.

    - `changes`, `folder`: as in `parse`.
    - `form`: class of the description, if it has other schemes.

    Raises DefinitionError with the path of the first invalid field.
    """
    if not isinstance(data, dict):
        raise DefinitionError("a scenario is a mapping with the keys " + ", ".join(ScenarioDescription.model_fields))
    require_readable(data)
    data = changed(data, changes or {}, folder)
    try:
        description = form.model_validate(data, context={"folder": folder})
    except ValidationError as error:
        raise translated(error, data) from None
    description.as_it_is()
    return description


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
