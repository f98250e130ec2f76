"""What a scenario file can name, read off the models themselves."""

from __future__ import annotations

from typing import Any, get_args

from .base import Description
from .disturbances import Term
from .load import described, names
from .robots import RobotDescription
from .schemes import EstimatorDescription, PerformanceDescription, SchemeDescription
from .trajectories import TrajectoryDescription


def catalogue() -> dict[str, dict[str, str]]:
    """Every kind of part with its members: a name and one line each."""
    return {
        "schemes": _members(SchemeDescription, "name"),
        "robots": _members(RobotDescription, "kind"),
        "trajectories": _members(TrajectoryDescription, "kind"),
        "disturbances": _members(Term, "kind"),
        "estimators": _members(EstimatorDescription, "kind"),
        "performance": _members(PerformanceDescription, "kind"),
        "scenarios": {name: described(name).title for name in names()},
    }


def _members(union: Any, key: str) -> dict[str, str]:
    """The members of a discriminated union, or of the single class that it still is."""
    classes: tuple[type[Description], ...] = (union,) if isinstance(union, type) else get_args(get_args(union)[0])
    found = {}
    for model in classes:
        (name,) = get_args(model.model_fields[key].annotation)
        found[name] = (model.__doc__ or "").strip().splitlines()[0]
    return found
