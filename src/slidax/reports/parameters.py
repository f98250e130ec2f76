"""The parameters of a scenario and of its law as text."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import equinox as eqx
import numpy as np

from slidax._writing import write_text
from slidax.robots import AbstractRobot
from slidax.scenarios import Scenario, ScenarioDescription
from slidax.scenarios.written import as_yaml, dumped


def write_scenario(description: ScenarioDescription, path: Path) -> None:
    """Write a validated `description` to `path` as YAML that runs from anywhere: its file names are absolute."""
    path.parent.mkdir(parents=True, exist_ok=True)
    parts = {name: _with_whole_paths(getattr(description, name)) for name in ("robot", "trajectory")}
    write_text(path, as_yaml(description.model_copy(update=parts)))


def _with_whole_paths(part: Any) -> Any:
    paths: dict[str, Any] = {}
    if isinstance(getattr(part, "file", None), str):
        paths["file"] = str(Path(part.file).resolve())
    if getattr(part, "packages", None):
        paths["packages"] = [str(Path(package).resolve()) for package in part.packages]
    return part.model_copy(update=paths) if paths else part


def parameters(scenario: Scenario) -> dict[str, str]:
    """The YAML of a `scenario`, and its law with the values of all parameters."""
    law = _values(scenario.controller)
    return {"The scenario": as_yaml(scenario.description), "The law with all its values": dumped(law)}


def _values(part: Any) -> Any:
    """Class name and fields; for a robot, which the scenario describes, only its class name."""
    if isinstance(part, AbstractRobot):
        return type(part).__name__
    if isinstance(part, eqx.Module):
        fields = {field.name: _values(getattr(part, field.name)) for field in dataclasses.fields(part)}
        return {"kind": type(part).__name__, **fields}
    if callable(part):
        return getattr(part, "__name__", type(part).__name__)
    return np.asarray(part).tolist() if eqx.is_array(part) else part
