"""The JSON schema of scenario files."""

from __future__ import annotations

from typing import Any

from .description import ScenarioDescription


def schema() -> dict[str, Any]:
    """Return the JSON schema of scenario files, for editors and other programs."""
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        **ScenarioDescription.model_json_schema(),
        "title": "slidax scenario",
    }
