"""Tuned gains of each scheme, and their ranges."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache
from importlib import resources
from typing import Any, Literal

import numpy as np
from pydantic import Field, TypeAdapter

from slidax._errors import DefinitionError
from slidax.controllers import Given, Preset
from slidax.parts import Parameter, parameters_of
from slidax.scenarios.base import AbstractDescription
from slidax.scenarios.description import ScenarioDescription
from slidax.scenarios.uncertainty import AbstractSet, AnySet
from slidax.scenarios.yaml_text import read_yaml

FACTOR = 30.0
"""Range of the gains of a user's scheme: its own values divided and multiplied by this factor."""

TUNABLE = ("one number", "one number or [n]", "[n]")


class GainDescription(AbstractDescription):
    """Range of a tuned gain, searched log-uniformly."""

    between: tuple[float, float]
    """The ends."""
    times: Literal["nothing", "inertia", "strength", "period"] = "nothing"
    """Scale of the ends: per joint the diagonal of the nominal inertia matrix at the start; the norm of the drives'
    torque limits; the period."""


class SchemeGains(AbstractDescription):
    """Tuned and fixed gains of a scheme of this package, by path in the scheme."""

    tuned: dict[str, GainDescription]
    """In both forms."""
    printed: dict[str, GainDescription] = Field(default={})
    """In printed form only."""
    sampled_data: dict[str, GainDescription] = Field(default={})
    """In sampled-data form only."""
    fixed: dict[str, Any] = Field(default={})
    """Fixed values."""
    fixed_sampled_data: dict[str, Any] = Field(default={})
    """Fixed values in sampled-data form only."""


@dataclass(frozen=True)
class Gains:
    """Tuned and fixed gains in one form, by path in the scheme."""

    tuned: dict[str, GainDescription]
    fixed: dict[str, Any]

    def sets(self, base: ScenarioDescription) -> dict[str, AbstractSet]:
        """Return the sets of the tuned gains by path, scaled for an arm.

        Raises DefinitionError if a range scales with torque limits that the arm does not have.
        """
        return {f"scheme.{path}": _set(gain, base) for path, gain in self.tuned.items()}


@cache
def _listed() -> dict[str, SchemeGains]:
    text = (resources.files("slidax.league") / "gains.yaml").read_text(encoding="utf-8")
    return TypeAdapter(dict[str, SchemeGains]).validate_python(read_yaml(text))


def gains_of(scheme: str, preset: Preset, form: str) -> Gains:
    """Return the gains of a scheme: those of `gains.yaml`, else every declared positive parameter.

    Raises DefinitionError if there is no gain to tune.
    """
    sampled = form == "sampled-data"
    if scheme in _listed():
        own = _listed()[scheme]
        tuned = {**own.tuned, **(own.sampled_data if sampled else own.printed)}
        return Gains(tuned, {**own.fixed, **(own.fixed_sampled_data if sampled else {})})
    tuned = dict(_by_declarations(preset))
    if not tuned:
        raise DefinitionError(f"`{scheme}` declares no parameter > 0 with a default, so that nothing can be tuned")
    return Gains(tuned, {})


def _by_declarations(preset: Preset) -> list[tuple[str, GainDescription]]:
    """Return all positive parameters of the law and its parts (without the envelope), around their own values."""
    gains = []
    for parameter in parameters_of(preset.law):
        value = preset.values.get(parameter.name, None if parameter.required else parameter.default)
        if isinstance(value, Given):
            if parameter.name == "transformation":
                continue
            for inner in parameters_of(value.part):
                gains += _gain(inner, value.values.get(inner.name), f"{parameter.name}.")
        elif parameter.name != "nominal":
            gains += _gain(parameter, value, "")
    return gains


def _gain(declared: Parameter, value: Any, place: str) -> list[tuple[str, GainDescription]]:
    value = declared.default if value is None and not declared.required else value
    if declared.shape not in TUNABLE or not isinstance(value, int | float) or not 0.0 < value < math.inf:
        return []
    ends = [end.number for end in declared.range.ends]
    low, high = value / FACTOR, value * FACTOR
    if any(end is None for end in ends):
        # The end is another gain: values near the scheme's own most likely respect it.
        low, high = value / 1.2, value * 1.2
    else:
        low = max(low, ends[0] + 0.02 * (value - ends[0])) if ends[0] is not None and ends[0] > -math.inf else low
        high = min(high, value + 0.98 * (ends[1] - value)) if ends[1] is not None and ends[1] < math.inf else high
    times: Literal["nothing", "inertia"] = "inertia" if declared.unit.startswith("N m") else "nothing"
    return [(f"{place}{declared.name}", GainDescription(between=(low, high), times=times))]


def _set(gain: GainDescription, base: ScenarioDescription) -> AbstractSet:
    scale: Any = 1.0
    moving = base.moving()
    if gain.times == "inertia":
        mass = np.diagonal(np.asarray(moving.arms.nominal.mass(moving.state0.q)))
        scale = np.array([float(f"{value:.3g}") for value in mass])
    elif gain.times == "strength":
        torque = np.broadcast_to(np.asarray(moving.drive.limits().torque), moving.state0.q.shape)
        if not np.isfinite(torque).all():
            raise DefinitionError("a gain scales with the drives' torque limits, but the task has none")
        scale = float(f"{np.linalg.norm(torque):.3g}")
    elif gain.times == "period":
        scale = base.simulation.period
    ends = [(end * scale).tolist() if isinstance(scale, np.ndarray) else end * scale for end in gain.between]
    return TypeAdapter(AnySet).validate_python({"between": ends, "distribution": "log_uniform"})
