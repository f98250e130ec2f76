"""What a scenario file can name, and what each of its parts is made from, read off the descriptions themselves."""

from __future__ import annotations

import typing
from typing import Any

from pydantic.fields import FieldInfo

from slidax._errors import DefinitionError, nearest, plain
from slidax.performance import AbstractPerformance
from slidax.reaching import AbstractBound, AbstractReaching
from slidax.surfaces import AbstractSurface
from slidax.transformations import AbstractTransformation

from .base import AbstractDescription
from .derived import union_of
from .description import ScenarioDescription, SimulationDescription
from .disturbances import Term
from .instruments import ActuatorDescription, InstrumentDescription, SensorDescription
from .load import described, names
from .robots import RobotDescription
from .sampled_data import AdaptationDescription, EstimatorDescription, RecoveryDescription, SampledDataDescription
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
"""Kinds of parts, each with the union of their descriptions."""

BLOCKS: dict[str, type[AbstractDescription]] = {
    "scenario": ScenarioDescription,
    "simulation": SimulationDescription,
    "sensor": SensorDescription,
    "actuator": ActuatorDescription,
    "sampled_data": SampledDataDescription,
    "recovery": RecoveryDescription,
}
"""Blocks of a scenario that are of one kind."""


def catalogue() -> dict[str, dict[str, str]]:
    """Every kind of part with its members: a name and one line each."""
    found = {kind: {name: _first_line(model) for name, model in members(kind).items()} for kind in KINDS}
    return {**found, "scenarios": {name: described(name).title for name in names()}}


def members(kind: str) -> dict[str, type[AbstractDescription]]:
    """The descriptions of a kind by their names.

    - `kind`: one of `KINDS`.
    """
    return _by_name(KINDS[kind])


def explained(name: str) -> dict[str, Any]:
    """A part's parameters: path, unit, range with its equation, default, the default's source, and meaning.

    - `name`: of a part, as `catalogue` has them, or `kind.name` where several kinds have that name; or of a block of a
      scenario, such as `sensor`.

    Raises DefinitionError if there is none of that name, or there are several.
    """
    kind, _, short = name.rpartition(".")
    found = {
        f"{one}.{label}": model
        for one in KINDS
        for label, model in members(one).items()
        if label == short and kind in ("", one)
    } | {label: model for label, model in BLOCKS.items() if label == name}
    if not found:
        known = [*KINDS, "scenarios", *BLOCKS, *(label for one in KINDS for label in members(one))]
        raise DefinitionError(f"there is nothing called `{plain(name)}`; {nearest(name, known)}")
    if len(found) > 1:
        raise DefinitionError(f"`{name}` is the name of several: say {' or '.join(f'`{one}`' for one in found)}")
    (model,) = found.values()
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
    said: Any = field.json_schema_extra if isinstance(field.json_schema_extra, dict) else {}
    unit, limits = str(said.get("unit", "")), str(said.get("range", ""))
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
        "source": str(said.get("source", "")),
        "meaning": meaning,
    }


def _described(field: FieldInfo) -> type[AbstractDescription] | None:
    """What is described there, where that is one thing: a block, or the part that a preset has."""
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
    found = [
        arg
        for arg in typing.get_args(field.annotation)
        if isinstance(arg, type) and issubclass(arg, AbstractDescription)
    ]
    return [model for model in found if "kind" in model.model_fields]


def _by_name(union: Any) -> dict[str, type[AbstractDescription]]:
    found = {}
    for model in typing.get_args(typing.get_args(union)[0]):
        field = model.model_fields.get("kind") or model.model_fields["name"]
        found[typing.get_args(field.annotation)[0]] = model
    return found


def _first_line(model: type[AbstractDescription]) -> str:
    return (model.__doc__ or "").strip().partition("\n")[0]
