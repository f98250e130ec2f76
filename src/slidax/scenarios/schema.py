"""The JSON schema of scenario files."""

from __future__ import annotations

from importlib import resources
from typing import Any

from .description import ScenarioDescription

SCHEMA_FILE = resources.files("slidax.scenarios") / "scenario.schema.json"
"""The schema as a file of the package; `make schema` writes it."""


def schema() -> dict[str, Any]:
    """The JSON schema of a scenario file, which editors and other programs can check one against."""
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        **ScenarioDescription.model_json_schema(),
        "title": "slidax scenario",
    }
