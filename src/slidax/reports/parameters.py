"""A scenario's parameters as text."""

from __future__ import annotations

import io
from typing import Any

from ruamel.yaml import YAML

from slidax.scenarios import ScenarioDescription
from slidax.scenarios.base import Description


def as_yaml(description: ScenarioDescription) -> str:
    """The scenario with all its values, as YAML that can be run again.

    - `description`: a validated scenario.
    """
    yaml = YAML()
    yaml.default_flow_style = None
    yaml.width = 100
    text = io.StringIO()
    yaml.dump(_shown(description), text)
    return text.getvalue()


def _shown(value: Any) -> Any:
    """Without what is not given; but null is shown where it says something else than nothing would."""
    if isinstance(value, Description):
        defaults = {name: field.default for name, field in type(value).model_fields.items()}
        return {name: _shown(part) for name, part in value if part is not None or defaults[name] is not None}
    return [_shown(part) for part in value] if isinstance(value, list | tuple) else value
