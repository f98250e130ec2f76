"""Carry a scenario elsewhere with all files that it names."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from slidax._files import read_bytes

from .description import ScenarioDescription
from .load import parse
from .robots import IdentifiedDescription
from .scenario import Scenario
from .written import as_yaml

PARTS = ("robot", "trajectory")
"""Blocks that may name a file."""


def portable(description: ScenarioDescription) -> tuple[str, dict[str, bytes]]:
    """Return a validated scenario as YAML with file names without folders, and the contents of these files.

    Meshes and included files of a URDF or MJCF file are left out; no run needs meshes.

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


def brought_back(text: str, files: Mapping[str, bytes], name: str) -> Scenario:
    """Build a scenario that `portable` wrote, such as that of a log.

    - `text`, `files`: of `portable`.
    - `name`: of the scenario.

    Raises DefinitionError if the scenario is invalid.
    """
    with tempfile.TemporaryDirectory() as folder:
        for file, content in files.items():
            # The name alone, so that a hostile log writes nowhere else.
            (Path(folder) / Path(file).name).write_bytes(content)
        return parse(text, folder=Path(folder)).build(name)
