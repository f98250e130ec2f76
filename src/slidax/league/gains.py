"""What is tuned of a scheme, and between which ends."""

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
"""What the gains of a scheme from elsewhere are tuned by, to both sides of its own numbers."""

TUNABLE = ("one number", "one number or [n]", "[n]")


class GainDescription(AbstractDescription):
    """A gain that is tuned by a factor, log-uniformly."""

    between: tuple[float, float]
    """The ends."""
    times: Literal["nothing", "inertia", "strength", "period"] = "nothing"
    """What they are multiplied by: the diagonal of the nominal inertia matrix at the start, joint by joint; the norm of
    the drives' limits of torque; the period."""


class SchemeGains(AbstractDescription):
    """What is tuned of a scheme of this package."""

    tuned: dict[str, GainDescription]
    """By path in the scheme."""
    printed: dict[str, GainDescription] = Field(default={})
    """In that form alone."""
    sampled_data: dict[str, GainDescription] = Field(default={})
    """In that form alone."""
    fixed: dict[str, Any] = Field(default={})
    """What is set, and not tuned."""
    fixed_sampled_data: dict[str, Any] = Field(default={})
    """The same in that form alone."""


@dataclass(frozen=True)
class Gains:
    """What is tuned, by path in the scheme, and what is set."""

    tuned: dict[str, GainDescription]
    fixed: dict[str, Any]

    def sets(self, base: ScenarioDescription) -> dict[str, AbstractSet]:
        """Sets by path for an arm.

        - `base`: the scenario.

        Raises DefinitionError if an end is to be multiplied by limits of torque that the arm has not.
        """
        return {f"scheme.{path}": _set(one, base) for path, one in self.tuned.items()}


@cache
def _listed() -> dict[str, SchemeGains]:
    text = (resources.files("slidax.league") / "gains.yaml").read_text(encoding="utf-8")
    return TypeAdapter(dict[str, SchemeGains]).validate_python(read_yaml(text))


def gains_of(scheme: str, preset: Preset, form: str) -> Gains:
    """What is tuned of a scheme: what the league's list says, or else every number that it has, by its declarations.

    - `scheme`: its name.
    - `preset`: its law with its parts.
    - `form`: in which it takes part.
    """
    sampled = form == "sampled-data"
    if scheme in _listed():
        one = _listed()[scheme]
        tuned = {**one.tuned, **(one.sampled_data if sampled else one.printed)}
        return Gains(tuned, {**one.fixed, **(one.fixed_sampled_data if sampled else {})})
    found = dict(_by_declarations(preset))
    if not found:
        raise DefinitionError(f"`{scheme}` declares no number > 0 with a default that could be tuned")
    return Gains(found, {})


def _by_declarations(preset: Preset) -> list[tuple[str, GainDescription]]:
    """Every positive number of the law, and of its parts but for the envelope's, around its own value."""
    found = []
    for one in parameters_of(preset.law):
        given = preset.given.get(one.name, None if one.required else one.default)
        if isinstance(given, Given):
            if one.name == "transformation":
                continue
            for inner in parameters_of(given.part):
                found += _one(inner, given.values.get(inner.name), f"{one.name}.")
        elif one.name != "nominal":
            found += _one(one, given, "")
    return found


def _one(declared: Parameter, value: Any, place: str) -> list[tuple[str, GainDescription]]:
    value = declared.default if value is None and not declared.required else value
    if declared.shape not in TUNABLE or not isinstance(value, int | float) or not 0.0 < value < math.inf:
        return []
    ends = [end.number for end in declared.range.ends]
    low, high = value / FACTOR, value * FACTOR
    if any(end is None for end in ends):
        # An end that is another gain: what is near to the scheme's own number keeps it in all likelihood.
        low, high = value / 1.2, value * 1.2
    else:
        low = max(low, ends[0] + 0.02 * (value - ends[0])) if ends[0] is not None and ends[0] > -math.inf else low
        high = min(high, value + 0.98 * (ends[1] - value)) if ends[1] is not None and ends[1] < math.inf else high
    times: Literal["nothing", "inertia"] = "inertia" if declared.unit.startswith("N m") else "nothing"
    return [(f"{place}{declared.name}", GainDescription(between=(low, high), times=times))]


def _set(one: GainDescription, base: ScenarioDescription) -> AbstractSet:
    scale: Any = 1.0
    moving = base.moving()
    if one.times == "inertia":
        mass = np.diagonal(np.asarray(moving.arms.nominal.mass(moving.state0.q)))
        scale = np.array([float(f"{value:.3g}") for value in mass])
    elif one.times == "strength":
        torque = np.broadcast_to(np.asarray(moving.drive.limits().torque), moving.state0.q.shape)
        if not np.isfinite(torque).all():
            raise DefinitionError("a gain is to fit the drives' limits of torque, but the task has none")
        scale = float(f"{np.linalg.norm(torque):.3g}")
    elif one.times == "period":
        scale = base.simulation.period
    ends = [(end * scale).tolist() if isinstance(scale, np.ndarray) else end * scale for end in one.between]
    return TypeAdapter(AnySet).validate_python({"between": ends, "distribution": "log_uniform"})
