"""Descriptions as YAML."""

from __future__ import annotations

import io
from typing import Any

from ruamel.yaml import YAML

from .base import AbstractDescription


def as_yaml(description: AbstractDescription) -> str:
    """A scenario or a study with all its values, as YAML that can be run again.

    - `description`: a validated one.
    """
    return dumped(_shown(description))


def dumped(values: Any) -> str:
    """Values as YAML.

    - `values`: mappings, lists and single values.
    """
    yaml = YAML()
    yaml.default_flow_style = None
    yaml.width = 100
    text = io.StringIO()
    yaml.dump(values, text)
    return text.getvalue()


def _shown(value: Any) -> Any:
    """Without what is not given; but null is shown where it says something else than nothing would."""
    if isinstance(value, AbstractDescription):
        defaults = {name: field.default for name, field in type(value).model_fields.items()}
        return {name: _shown(part) for name, part in value if part is not None or defaults[name] is not None}
    if isinstance(value, dict):
        return {name: _shown(part) for name, part in value.items()}
    return [_shown(part) for part in value] if isinstance(value, list | tuple) else value
