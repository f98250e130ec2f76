"""Catalogue of the parts that a scenario file can name, and its JSON schema."""

from __future__ import annotations

import typing
from typing import Any

from pydantic.fields import FieldInfo

from slidax.core.errors import DefinitionError, nearest_word, plain_name
from slidax.law.envelopes import AbstractPerformance
from slidax.law.error_transformations import AbstractTransformation
from slidax.law.reaching_laws import AbstractReaching
from slidax.law.surfaces import AbstractSurface
from slidax.law.torque_bounds import AbstractBound

from .descriptions import AbstractDescription, union_of
from .instruments import (
    ActuatorDescription,
    ElasticityDescription,
    InstrumentDescription,
    LuGreDescription,
    SensorDescription,
    Term,
    TransmissionDescription,
)
from .load import names, read_description
from .robots import RobotDescription
from .sampled_data import (
    AdaptationDescription,
    CalmDescription,
    EstimatorDescription,
    RecoveryDescription,
    SampledDataDescription,
)
from .scenario import ScenarioDescription, SimulationDescription
from .schemes import AnyScheme
from .trajectories import TrajectoryDescription

KINDS = {
    "schemes": AnyScheme,
    "transformations": union_of(AbstractTransformation),
    "performance": union_of(AbstractPerformance),
    "surfaces": union_of(AbstractSurface),
    "reaching": union_of(AbstractReaching),
    "bounds": union_of(AbstractBound),
    "estimators": EstimatorDescription,
    "adaptations": AdaptationDescription,
    "sensors": InstrumentDescription,
    "robots": RobotDescription,
    "trajectories": TrajectoryDescription,
    "disturbances": Term,
}
"""Kinds of parts, each with the union of its pydantic models."""

BLOCKS: dict[str, type[AbstractDescription]] = {
    "scenario": ScenarioDescription,
    "simulation": SimulationDescription,
    "sensor": SensorDescription,
    "actuator": ActuatorDescription,
    "transmission": TransmissionDescription,
    "lugre": LuGreDescription,
    "elasticity": ElasticityDescription,
    "sampled_data": SampledDataDescription,
    "recovery": RecoveryDescription,
    "calm": CalmDescription,
}
"""Blocks of a scenario that have only one form."""


def catalogue() -> dict[str, dict[str, str]]:
    """Return one line of text for each part and built-in scenario, by kind and name.

    For example, `catalogue()["schemes"]["pid"]`. The kind "scenarios" has the titles of the scenarios.
    """
    parts = {kind: {name: _first_line(model) for name, model in members(kind).items()} for kind in KINDS}
    return {**parts, "scenarios": {name: read_description(name).title for name in names()}}


def members(kind: str) -> dict[str, type[AbstractDescription]]:
    """Return the pydantic models for all parts of a kind, by name.

    - `kind`: a key of `KINDS`, such as "surfaces".
    """
    return _by_name(KINDS[kind])


def explain_parameters(name: str) -> dict[str, Any]:
    """Return a part's name, title and parameters, each with path, unit, range, default, default's source and meaning.

    - `name`: name of a part in `catalogue`, `kind.name` if several kinds have this name, or a block of a scenario, such
      as `sensor`.

    Raises DefinitionError if the name is unknown or ambiguous.
    """
    prefix, _, short = name.rpartition(".")
    matches = {
        f"{kind}.{label}": model
        for kind in KINDS
        for label, model in members(kind).items()
        if label == short and prefix in ("", kind)
    } | {label: model for label, model in BLOCKS.items() if label == name}
    if not matches:
        known = [*KINDS, "scenarios", *BLOCKS, *(label for kind in KINDS for label in members(kind))]
        raise DefinitionError(f"there is no part `{plain_name(name)}`; {nearest_word(name, known)}")
    if len(matches) > 1:
        raise DefinitionError(f"ambiguous name `{name}`: use {' or '.join(f'`{match}`' for match in matches)}")
    (model,) = matches.values()
    return {"name": name, "title": _first_line(model), "parameters": _rows(model, "")}


def _rows(model: type[AbstractDescription], path: str) -> list[dict[str, Any]]:
    rows = []
    for name, field in model.model_fields.items():
        if name in ("kind", "name"):
            continue
        inner = _described(field)
        if inner is None:
            rows.append(_row(f"{path}{name}", field))
            continue
        if "kind" in inner.model_fields:
            choices = f"one of {', '.join(_choices(field))}"
            rows.append(_row(f"{path}{name}.kind", inner.model_fields["kind"]) | {"range": choices})
        rows += _rows(inner, f"{path}{name}.")
    return rows


def _row(path: str, field: FieldInfo) -> dict[str, Any]:
    extra: Any = field.json_schema_extra if isinstance(field.json_schema_extra, dict) else {}
    unit, limits = str(extra.get("unit", "")), str(extra.get("range", ""))
    meaning = " ".join((field.description or "").split()).removesuffix(".")
    for suffix in (f", {limits}" if limits else "", f" [{unit}]" if unit else ""):
        meaning = meaning.removesuffix(suffix)
    choices = _choices(field)
    default = None if field.is_required() else field.get_default(call_default_factory=True)
    return {
        "path": path,
        "unit": unit,
        "range": limits or (f"one of {', '.join(choices)}" if choices else ""),
        "default": default.model_dump() if isinstance(default, AbstractDescription) else default,
        "required": field.is_required(),
        "source": str(extra.get("source", "")),
        "meaning": meaning,
    }


def _described(field: FieldInfo) -> type[AbstractDescription] | None:
    """The description whose parameters belong to a field: its block, or the preset's part; None without either."""
    if isinstance(field.annotation, type) and issubclass(field.annotation, AbstractDescription):
        return field.annotation
    preset = [model for model in _models(field) if not model.model_fields["kind"].is_required()]
    return preset[0] if preset else None


def _choices(field: FieldInfo) -> list[str]:
    if typing.get_origin(field.annotation) is typing.Literal:
        return [str(choice) for choice in typing.get_args(field.annotation)]
    return [typing.get_args(model.model_fields["kind"].annotation)[0] for model in _models(field)]


def _models(field: FieldInfo) -> list[type[AbstractDescription]]:
    """The members of a union of kinds."""
    return [
        model
        for model in typing.get_args(field.annotation)
        if isinstance(model, type) and issubclass(model, AbstractDescription) and "kind" in model.model_fields
    ]


def _by_name(union: Any) -> dict[str, type[AbstractDescription]]:
    models = {}
    for model in typing.get_args(typing.get_args(union)[0]):
        field = model.model_fields.get("kind") or model.model_fields["name"]
        models[typing.get_args(field.annotation)[0]] = model
    return models


def _first_line(model: type[AbstractDescription]) -> str:
    return (model.__doc__ or "").strip().partition("\n")[0]


def schema() -> dict[str, Any]:
    """Return the JSON schema of scenario files, for editors and other programs."""
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        **ScenarioDescription.model_json_schema(),
        "title": "slidax scenario",
    }
