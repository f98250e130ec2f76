"""Scenario values with a slider on a page: unit, range and meaning."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from pydantic import BaseModel

from slidax.core.errors import DefinitionError
from slidax.scenarios.scenario import ScenarioDescription
from slidax.scenarios.uncertain_values import Leaf, leaf_of

ROOTS = {
    "scheme.transformation": "Envelope",
    "scheme.sampled_data": "Sampled data",
    "scheme": "Law",
    "robot.plant": "True arm",
    "disturbance": "Disturbance",
    "sensor": "Sensor",
    "actuator": "Drives",
}
"""Scenario blocks with tunable values, and the titles of their groups on the page; the first matching block counts."""

ORDER = ("Envelope", "Law", "True arm", "Disturbance", "Sensor", "Drives", "Sampled data")
"""Order of the groups on the page; learning and recovery, which are in `Sampled data`, come last."""

NEVER = ("seed", "kind", "lengths", "phase", "attached", "gravity_acceleration", "torque_density")
"""Fields without a slider, such as noise seeds and values that define another arm."""

REACH = 10.0
"""A slider extends from the default divided by this ratio to the default times it, within the declared range."""

ABOVE = 1.01
"""Ratio by which a slider ends before another value of the scenario that is a bound of the slider's value."""

_END = re.compile(r"^(>=?) (\w+)|^([\[(])\s*([^,]+), ([^\])]+)[\])]")

FROM_ZERO = {
    "coulomb": 2.0,
    "adaptation.coulomb": 0.2,
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
"""Upper end of the slider for values whose default is 0; the lower end is 0."""


@dataclass(frozen=True)
class Tunable:
    """A scenario value with a slider: one number for all joints, or one for each joint.

    - `leaf`: its path in the scenario, with its unit and the scenario's own value.
    - `title`, `group`, `meaning`: texts on the page.
    - `low`, `high`: range of the slider; the declared range may be wider.
    - `logarithmic`: True for a logarithmic slider.
    - `declared`: the declared range as text; empty if any number is allowed.
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
        """Path of the value, as in `--set`."""
        return self.leaf.path

    @property
    def each(self) -> bool:
        """True if each joint may have its own value."""
        return self.leaf.per_joint

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the program's input."""
        return self.leaf.shape_of_each

    @property
    def defaults(self) -> np.ndarray:
        """The scenario's own value, in the shape of the program's input."""
        assert self.leaf.own is not None
        return np.broadcast_to(self.leaf.own, self.shape).astype(float)

    def entry(self, start: int) -> dict[str, Any]:
        """Return the value's entry in the manifest (a page's JSON data); `start` is the index of its first number."""
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


def tunables_of(description: ScenarioDescription, joints: int) -> list[Tunable]:
    """Return the candidates for a slider, sorted by group, within a group in the order of the scenario.

    `PageSetting.build` leaves out candidates on which the compiled code depends: they get no slider.

    - `description`: the scenario; it contains the robot's description itself, and not the name of its file.
    - `joints`: number of joints.
    """
    tunables = []
    for path, field in _numbers(description, ""):
        group = next((name for root, name in ROOTS.items() if f"{path}.".startswith(f"{root}.")), None)
        if group is None or any(part in NEVER for part in path.split(".")):
            continue
        try:
            leaf = leaf_of(description, path, joints)
        except DefinitionError:
            continue
        if leaf.own is None or leaf.integer or leaf.own.ndim > 1 or not np.isfinite(leaf.own).all():
            continue
        tunables.append(_tunable(leaf, group, field, _beside(description, leaf.path)))
    return sorted(tunables, key=lambda tunable: ORDER.index(tunable.group))


def _numbers(place: Any, path: str) -> Iterator[tuple[str, Any]]:
    """Yield dotted path and declaration of each field below `place`, without those that are blocks of fields."""
    if isinstance(place, BaseModel):
        for name, field in type(place).model_fields.items():
            value = getattr(place, name)
            inner = f"{path}.{name}" if path else name
            if isinstance(value, BaseModel | tuple):
                yield from _numbers(value, inner)
            else:
                yield inner, field
    elif isinstance(place, tuple):
        for k, item in enumerate(place):
            if isinstance(item, BaseModel):
                yield from _numbers(item, f"{path}.{k}")


def _tunable(leaf: Leaf, group: str, field: Any, beside: tuple[float, float]) -> Tunable:
    extra = field.json_schema_extra if isinstance(field.json_schema_extra, dict) else {}
    declared, unit = str(extra.get("range", "")), leaf.unit
    meaning = " ".join((field.description or "").split()).removesuffix(".")
    for suffix in (f", {declared}" if declared else "", f" [{unit}]" if unit else ""):
        meaning = meaning.removesuffix(suffix)
    low, high, logarithmic = _span(leaf)
    assert leaf.own is not None
    low = max(low, min(beside[0], float(leaf.own.min())))
    high = min(high, max(beside[1], float(leaf.own.max())))
    name = leaf.path.rpartition(".")[2]
    title = name.replace("_", " ")
    within = leaf.path.split(".")
    if within[-2].isdigit():
        title = f"{title}, term {int(within[-2]) + 1}"
    elif within[-2] == "performance" and name in ("initial", "final"):
        title = f"{name} radius"
    elif within[-2] in ("load", "recovery", "adaptation", "estimator", "surface", "reaching", "bound"):
        title = f"{within[-2].replace('load', 'payload')} {title}"
    return Tunable(leaf, title, group, meaning, low, high, logarithmic, declared)


def _beside(description: ScenarioDescription, path: str) -> tuple[float, float]:
    """Return lower and upper bound of a slider that come from other values of the scenario.

    The other values are ends of this value's range, or have this value as an end of their range.
    """
    lower, upper = -np.inf, np.inf
    *parents, name = path.split(".")
    if path == "scheme.sampled_data.horizon":
        # A horizon must be at least one period, and the page may offer twice the scenario's period.
        lower = 2.0 * description.simulation.period
    place = value_at(description, parents)
    if not isinstance(place, BaseModel):
        return lower, upper
    ranges = _ranges(place)
    others = {other: getattr(place, other) for other in ranges}
    for other, declared in ranges.items():
        least, most = _named(declared)
        if other == name:
            lower = max([lower, *(ABOVE * value for value in _numbers_at(others, least))])
            upper = min([upper, *(value / ABOVE for value in _numbers_at(others, most))])
        elif least == name:
            upper = min([upper, *(value / ABOVE for value in _numbers_at(others, other))])
        elif most == name:
            lower = max([lower, *(ABOVE * value for value in _numbers_at(others, other))])
    return lower, upper


def value_at(place: Any, names: Iterable[str]) -> Any:
    """Return the value inside an object at a path, which is a list of field names and indices."""
    for name in names:
        place = place[int(name)] if isinstance(place, tuple | list) else getattr(place, name)
    return place


def _ranges(place: BaseModel) -> dict[str, str]:
    """Return the declared range of each field as text."""
    extras = {name: field.json_schema_extra for name, field in type(place).model_fields.items()}
    return {name: str(extra.get("range", "")) for name, extra in extras.items() if isinstance(extra, dict)}


def _named(declared: str) -> tuple[str, str]:
    """Return the ends of a declared range as texts: numbers, or names of other values."""
    ends = _END.match(declared)
    if ends is None:
        return "", ""
    return (ends[2], "") if ends[2] else (ends[4].strip(), ends[5].strip())


def _numbers_at(beside: Mapping[str, Any], name: str) -> list[float]:
    value = beside.get(name)
    return [] if value is None or isinstance(value, str | BaseModel) else np.ravel(np.asarray(value, float)).tolist()


def _span(leaf: Leaf) -> tuple[float, float, bool]:
    """Return the lowest and highest value of a slider, and True if it is logarithmic."""
    assert leaf.own is not None
    lower, upper = leaf.ends
    *_, block, name = leaf.path.split(".")
    size = np.abs(leaf.own)
    if np.isfinite(lower) and np.isfinite(upper) and upper - lower < 1e3:
        # The range may exclude its ends.
        gap = 0.01 * (upper - lower)
        return lower + gap if lower not in leaf.own else lower, upper - gap if upper not in leaf.own else upper, False
    if not size.any():
        return 0.0, FROM_ZERO.get(f"{block}.{name}", FROM_ZERO.get(name, 1.0)), False
    if (leaf.own <= 0).any():
        reach = 3.0 * float(size.max())
        return max(-reach, lower), min(reach, upper), False
    least, most = float(size.min()), float(size.max())
    if name in FROM_ZERO and lower == 0.0:
        high = max(FROM_ZERO[name], 3.0 * most)
        # A payload with an inertia needs a mass.
        return (1e-3 * high if block == "load" else 0.0), high, False
    low = least / REACH if lower <= 0 else max(lower + 0.01 * (least - lower), least / REACH)
    return _rounded(low) if _rounded(low) > lower else low, _rounded(min(most * REACH, upper)), True


def _rounded(value: float) -> float:
    return float(f"{value:.2g}")
