"""Read scenarios from files, and pack a scenario together with the files to which it refers."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from importlib import resources
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from slidax.core.errors import DefinitionError, nearest_word, plain_name
from slidax.core.files import read_bytes, read_text

from .changes import with_changes
from .robots import IdentifiedDescription
from .scenario import Scenario, ScenarioDescription
from .yaml_text import as_yaml, read_yaml, require_readable, validation_error

BUILT_IN = resources.files("slidax.scenarios") / "built_in"


def names() -> list[str]:
    """Return the names of the built-in scenarios."""
    return sorted(Path(entry.name).stem for entry in BUILT_IN.iterdir() if entry.name.endswith(".yaml"))


def load(scenario: str | Path, changes: dict[str, Any] | None = None) -> Scenario:
    """Read and build a scenario.

    - `scenario`: name of a built-in scenario, or path of a YAML file.
    - `changes`: new values by dotted path, such as `{"disturbance.scale": 0.0}` or `{"start.q[elbow]": 0.3}`, set
      before validation; an index is a joint's name or a number from 0. `scheme.name` is set first; the new scheme keeps
      the file's envelope, `sampled_data`, and parameters of the bound that its preset does not set. File paths in
      changes are relative to the current folder.

    Raises DefinitionError if the scenario does not exist or is invalid.
    """
    name, text = _read(scenario)
    return parse(text, changes, folder=_folder(scenario)).build(name)


def alter(scenario: Scenario, changes: dict[str, Any]) -> Scenario:
    """Return a scenario with new values by dotted path, as if `load` had read it with these changes.

    Changes by `Scenario.replace` are lost.

    Raises DefinitionError if a value is invalid.
    """
    return alter_description(scenario.description, changes).build(scenario.name)


def alter_description(description: ScenarioDescription, changes: dict[str, Any]) -> ScenarioDescription:
    """Return a description with new values by dotted path, as in `load`.

    Raises DefinitionError if a value is invalid.
    """
    return description.changed(changes)


def read_description(scenario: str | Path) -> ScenarioDescription:
    """Read the validated description of a scenario without building it.

    - `scenario`: name of a built-in scenario, or path of a YAML file.

    Raises DefinitionError if the scenario does not exist or is invalid.
    """
    return parse(_read(scenario)[1], folder=_folder(scenario))


def parse(text: str, changes: dict[str, Any] | None = None, *, folder: str | Path = Path()) -> ScenarioDescription:
    """Return the validated description in a YAML text.

    - `changes`: new values by dotted path, set before validation, as in `load`.
    - `folder`: folder to which file names in the text are relative.

    Raises DefinitionError with the path of the first invalid field.
    """
    return validate_text(read_yaml(text), changes, folder=Path(folder))


def validate_text(
    data: Any,
    changes: dict[str, Any] | None = None,
    *,
    folder: Path = Path(),
    form: type[ScenarioDescription] = ScenarioDescription,
) -> ScenarioDescription:
    """Return the validated description in a mapping from a YAML text.

    - `data`: the mapping.
    - `changes`, `folder`: as in `parse`.
    - `form`: class of the description; `with_scheme` returns one for a further scheme.

    Raises DefinitionError with the path of the first invalid field.
    """
    if not isinstance(data, dict):
        raise DefinitionError("a scenario must be a mapping with keys " + ", ".join(ScenarioDescription.model_fields))
    require_readable(data)
    data = with_changes(data, changes or {}, folder)
    try:
        description = form.model_validate(data, context={"folder": folder})
    except ValidationError as error:
        raise validation_error(error, data) from None
    description.as_it_is()
    return description


def _folder(scenario: str | Path) -> Path:
    return Path(scenario).parent if Path(scenario).suffix in (".yaml", ".yml") else Path()


def _read(scenario: str | Path) -> tuple[str, str]:
    path = Path(scenario)
    if path.suffix in (".yaml", ".yml"):
        return path.stem, read_text(path, "the scenario file")
    if str(scenario) not in names():
        raise DefinitionError(
            f"unknown scenario `{plain_name(scenario)}`; {nearest_word(str(scenario), names())} "
            "(a file's name must end in .yaml)"
        )
    return str(scenario), (BUILT_IN / f"{scenario}.yaml").read_text(encoding="utf-8")


PARTS = ("robot", "trajectory")
"""Blocks of a scenario that may refer to a file."""


def portable_text(description: ScenarioDescription) -> tuple[str, dict[str, bytes]]:
    """Return a scenario as YAML, and the contents of the files to which it refers, by their names in this YAML.

    These names have no folders. Meshes and included files of a URDF or MJCF file are left out. `restore` therefore
    fails for a xacro or MJCF file that includes others, and for an MJCF file that computes an inertia from a mesh.

    Raises DefinitionError if a file does not exist.
    """
    files: dict[str, bytes] = {}
    parts = {}
    for name in PARTS:
        part: Any = getattr(description, name)
        if isinstance(part, IdentifiedDescription):
            part = part.resolved()
        if isinstance(getattr(part, "file", None), str):
            path = Path(part.file)
            files[f"{name}-{path.name}"] = read_bytes(path)
            part = part.model_copy(update={"file": f"{name}-{path.name}"})
        parts[name] = part
    return as_yaml(description.model_copy(update=parts)), files


def restore(text: str, files: Mapping[str, bytes], name: str) -> Scenario:
    """Build a scenario from the result of `portable_text`, such as the one in a log.

    - `text`, `files`: as returned by `portable_text`.
    - `name`: name of the scenario.

    Raises DefinitionError if the scenario is invalid.
    """
    with tempfile.TemporaryDirectory() as folder:
        for file, content in files.items():
            # Use only the file's name, so that a hostile log cannot write elsewhere.
            (Path(folder) / Path(file).name).write_bytes(content)
        return parse(text, folder=Path(folder)).build(name)
