"""The parameters of a scenario, and of the law that it makes, as text."""

from __future__ import annotations

import dataclasses
import io
from typing import Any

import equinox as eqx
import numpy as np
from ruamel.yaml import YAML

from slidax.robots import AbstractRobot
from slidax.scenarios import Scenario, ScenarioDescription
from slidax.scenarios.base import AbstractDescription


def as_yaml(description: ScenarioDescription) -> str:
    """The scenario with all its values, as YAML that can be run again.

    - `description`: a validated scenario.
    """
    return _dumped(_shown(description))


def parameters(scenario: Scenario) -> dict[str, str]:
    """The scenario as its file has it, and its law with the values that it has where the file gives none.

    - `scenario`: whose parameters.
    """
    law = _values(scenario.controller)
    return {"The scenario": as_yaml(scenario.description), "The law with all its values": _dumped(law)}


def _dumped(values: Any) -> str:
    yaml = YAML()
    yaml.default_flow_style = None
    yaml.width = 100
    text = io.StringIO()
    yaml.dump(values, text)
    return text.getvalue()


def _values(part: Any) -> Any:
    """The part's class and its fields by name, with the robot, which the scenario describes, by its kind alone."""
    if isinstance(part, AbstractRobot):
        return type(part).__name__
    if isinstance(part, eqx.Module):
        fields = {field.name: _values(getattr(part, field.name)) for field in dataclasses.fields(part)}
        return {"kind": type(part).__name__, **fields}
    if callable(part):
        return getattr(part, "__name__", type(part).__name__)
    return np.asarray(part).tolist() if eqx.is_array(part) else part


def _shown(value: Any) -> Any:
    """Without what is not given; but null is shown where it says something else than nothing would."""
    if isinstance(value, AbstractDescription):
        defaults = {name: field.default for name, field in type(value).model_fields.items()}
        return {name: _shown(part) for name, part in value if part is not None or defaults[name] is not None}
    return [_shown(part) for part in value] if isinstance(value, list | tuple) else value
