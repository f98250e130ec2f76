"""The numbers of a scenario that a page can change, each with its unit, range and meaning."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from pydantic import BaseModel

from slidax._errors import DefinitionError
from slidax.scenarios import ScenarioDescription
from slidax.scenarios.load import validated
from slidax.scenarios.uncertainty.leaf import Leaf, leaf_of

ROOTS = {
    "scheme.transformation": "Envelope",
    "scheme.sampled_data": "Sampled data",
    "scheme": "Law",
    "robot.plant": "The arm as it is",
    "disturbance": "Disturbance",
    "sensor": "Sensor",
    "actuator": "Drives",
}
"""Blocks whose numbers vary, and what the page calls them; the first that fits counts."""

ORDER = ("Envelope", "Law", "The arm as it is", "Disturbance", "Sensor", "Drives", "Sampled data")
"""Of the groups: what the law learns by, and how it recovers, comes last."""

NEVER = ("seed", "kind", "lengths", "phase", "attached", "gravity_acceleration", "torque_density")
"""Numbers that nobody turns: names of noise, and what would be another arm."""

REACH = 10.0
"""A range that is not declared goes from a default's tenth to its tenfold."""

HALVINGS = 12
"""Of the way to an end that the scenario refuses."""

FROM_ZERO = {
    "coulomb": 2.0,
    "viscous": 2.0,
    "mass": 3.0,
    "position_noise": 1e-4,
    "velocity_noise": 1e-2,
    "resolution": 1e-4,
    "armature": 0.5,
    "time_constant": 2e-3,
    "b0": 20.0,
    "b1": 5.0,
    "b2": 5.0,
    "layer": 0.1,
    "scale": 3.0,
}
"""Where the range begins that a default of 0 has: at 0, and its end."""


@dataclass(frozen=True)
class Knob:
    """One number, or one for each joint.

    - `leaf`: where it stands, with unit and own value.
    - `title`, `group`, `meaning`: for a person.
    - `low`, `high`: what the slider reaches, which the declared range may exceed.
    - `logarithmic`: whether the slider's scale is.
    - `declared`: the range as it is declared; empty for any number.
    """

    leaf: Leaf
    title: str
    group: str
    meaning: str
    low: float
    high: float
    logarithmic: bool
    declared: str

    @property
    def path(self) -> str:
        """As of `--set`."""
        return self.leaf.path

    @property
    def each(self) -> bool:
        """Whether there may be one for each joint."""
        return self.leaf.per_joint

    @property
    def shape(self) -> tuple[int, ...]:
        """Of what the program takes."""
        return self.leaf.shape_of_each

    @property
    def defaults(self) -> np.ndarray:
        """The scenario's own value, as the program takes it."""
        assert self.leaf.own is not None
        return np.broadcast_to(self.leaf.own, self.shape).astype(float)

    def entry(self, start: int) -> dict[str, Any]:
        """The knob in a playground.

        - `start`: place of its first number among the program's inputs.
        """
        assert self.leaf.own is not None
        return {
            "path": self.path,
            "title": self.title,
            "group": self.group,
            "unit": self.leaf.unit,
            "low": self.low,
            "high": self.high,
            "default": self.leaf.own.tolist(),
            "scale": "log" if self.logarithmic else "linear",
            "inputs": [start, int(np.prod(self.shape, dtype=int))],
            "meaning": self.meaning,
            "each": self.each,
            "range": self.declared,
        }


def knobs_of(description: ScenarioDescription, joints: int) -> list[Knob]:
    """All that may be knobs, in the order of the file; whether a compiled loop can vary them is not asked.

    - `description`: the scenario, with its robot resolved.
    - `joints`: of its arm.
    """
    found = []
    for path, said in _numbers(description, ""):
        group = next((name for root, name in ROOTS.items() if f"{path}.".startswith(f"{root}.")), None)
        if group is None or any(part in NEVER for part in path.split(".")):
            continue
        try:
            leaf = leaf_of(description, path, joints)
        except DefinitionError:
            continue
        if leaf.own is None or leaf.integer or leaf.own.ndim > 1 or not np.isfinite(leaf.own).all():
            continue
        found.append(_drawn_in(description, _knob(leaf, group, said)))
    return sorted(found, key=lambda knob: ORDER.index(knob.group))


def _numbers(place: Any, path: str) -> Iterator[tuple[str, Any]]:
    """Every field that is no mapping, with what its declaration says."""
    if isinstance(place, BaseModel):
        for name, field in type(place).model_fields.items():
            value = getattr(place, name)
            inner = f"{path}.{name}" if path else name
            if isinstance(value, BaseModel | tuple):
                yield from _numbers(value, inner)
            else:
                yield inner, field
    elif isinstance(place, tuple):
        for k, one in enumerate(place):
            if isinstance(one, BaseModel):
                yield from _numbers(one, f"{path}.{k}")


def _knob(leaf: Leaf, group: str, field: Any) -> Knob:
    extra = field.json_schema_extra if isinstance(field.json_schema_extra, dict) else {}
    declared, unit = str(extra.get("range", "")), leaf.unit
    meaning = " ".join((field.description or "").split()).removesuffix(".")
    for suffix in (f", {declared}" if declared else "", f" [{unit}]" if unit else ""):
        meaning = meaning.removesuffix(suffix)
    low, high, logarithmic = _span(leaf)
    name = leaf.path.rpartition(".")[2]
    title = name.replace("_", " ")
    within = leaf.path.split(".")
    if within[-2].isdigit():
        title = f"{title}, term {int(within[-2]) + 1}"
    elif within[-2] in ("load", "recovery", "adaptation", "estimator", "surface", "reaching", "bound"):
        title = f"{within[-2].replace('load', 'payload')} {title}"
    return Knob(leaf, title, group, meaning, low, high, logarithmic, declared)


def _span(leaf: Leaf) -> tuple[float, float, bool]:
    """Lowest and highest, and whether the scale is logarithmic."""
    assert leaf.own is not None
    lower, upper = leaf.ends
    name = leaf.path.rpartition(".")[2]
    size = np.abs(leaf.own)
    if np.isfinite(lower) and np.isfinite(upper) and upper - lower < 1e3:
        # An end itself may be outside.
        room = 0.01 * (upper - lower)
        return lower + room if lower not in leaf.own else lower, upper - room if upper not in leaf.own else upper, False
    if not size.any():
        return 0.0, FROM_ZERO.get(name, 1.0), False
    if (leaf.own <= 0).any():
        reach = 3.0 * float(size.max())
        return max(-reach, lower), min(reach, upper), False
    least, most = float(size.min()), float(size.max())
    if name in FROM_ZERO and lower == 0.0:
        return 0.0, max(FROM_ZERO[name], 3.0 * most), False
    low = least / REACH if lower <= 0 else max(lower + 0.01 * (least - lower), least / REACH)
    return _rounded(low), _rounded(min(most * REACH, upper)), True


def _rounded(value: float) -> float:
    return float(f"{value:.2g}")


def _drawn_in(description: ScenarioDescription, knob: Knob) -> Knob:
    """The slider without what the scenario refuses at its ends: it must stay above or below other numbers, too."""
    data = description.model_dump(exclude_unset=True)
    shape = () if knob.each else knob.shape

    def taken(value: float) -> bool:
        try:
            validated(data, {knob.path: np.full(shape, value).tolist()}, form=type(description)).build("end")
        except DefinitionError:
            return False
        return True

    def end(refused: float, own: float, rounds: Callable[[float], int]) -> float:
        if taken(refused) or not taken(own):
            return refused
        good, bad = own, refused
        for _ in range(HALVINGS):
            between = 0.5 * (good + bad)
            good, bad = (between, bad) if taken(between) else (good, between)
        size = 10.0 ** (math.floor(math.log10(abs(good))) - 2) if good else 1.0
        rounded = float(f"{rounds(good / size) * size:.6g}")
        return rounded if taken(rounded) else good

    least, most = float(knob.defaults.min()), float(knob.defaults.max())
    return replace(knob, low=end(knob.low, least, math.ceil), high=end(knob.high, most, math.floor))
