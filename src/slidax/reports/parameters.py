"""A scenario's parameters as text."""

from __future__ import annotations

import io

from ruamel.yaml import YAML

from slidax.scenarios import ScenarioDescription


def as_yaml(description: ScenarioDescription) -> str:
    """The scenario with all its values, as YAML that can be run again.

    - `description`: a validated scenario.
    """
    yaml = YAML()
    yaml.default_flow_style = None
    yaml.width = 100
    text = io.StringIO()
    yaml.dump(description.model_dump(mode="json", exclude_none=True), text)
    return text.getvalue()
