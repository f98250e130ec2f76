"""Write descriptions as YAML."""

from __future__ import annotations

import io
from typing import Any

from ruamel.yaml import YAML

from .base import AbstractDescription


def as_yaml(description: AbstractDescription) -> str:
    """Return a scenario or a study with all its values as YAML that can be run again."""
    return dumped(_shown(description))


def dumped(values: Any) -> str:
    """Return mappings, lists and single values as YAML."""
    yaml = YAML()
    yaml.default_flow_style = None
    yaml.width = 100
    text = io.StringIO()
    yaml.dump(values, text)
    return text.getvalue()


def _shown(value: Any) -> Any:
    """Plain values without null, except where null differs from the default."""
    if isinstance(value, AbstractDescription):
        defaults = {name: field.default for name, field in type(value).model_fields.items()}
        return {name: _shown(part) for name, part in value if part is not None or defaults[name] is not None}
    if isinstance(value, dict):
        return {name: _shown(part) for name, part in value.items()}
    return [_shown(part) for part in value] if isinstance(value, list | tuple) else value
