"""A motion as a checked table of numbers, before it is a trajectory."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from slidax._errors import DefinitionError, DefinitionWarning, counted, nearest
from slidax._names import are_numbered, matched, quoted

from .motion_limits import called

JOINTS = "`joints` (on the command line `--set 'trajectory.joints=[...]'`)"

TIME_UNITS = {"s": 1.0, "sec": 1.0, "ms": 1e-3, "us": 1e-6, "μs": 1e-6, "ns": 1e-9}
"""Units of time in s."""

DEGREE = np.pi / 180

UNITS = {
    "positions": {"rad": 1.0, "m": 1.0, "deg": DEGREE, "°": DEGREE, "degrees": DEGREE, "mm": 1e-3},
    "velocities": {"rad/s": 1.0, "m/s": 1.0, "deg/s": DEGREE, "°/s": DEGREE, "rpm": np.pi / 30, "mm/s": 1e-3},
    "accelerations": {"rad/s2": 1.0, "m/s2": 1.0, "deg/s2": DEGREE, "°/s2": DEGREE, "mm/s2": 1e-3},
}
"""Units of the columns in SI."""

CLOCK = 1e6
"""Times beyond this [s] are a clock's, not a motion's: of their digits too few would be left for the motion."""


@dataclass(frozen=True)
class Table:
    """Positions over time, optionally with velocities and accelerations.

    - `source`: origin of the data, for messages.
    - `joints`: names; empty for a table of numbers alone.
    - `rows`: label of each row in messages, such as `line 7`.
    - `times`: [k], s.
    - `positions`: [k n], rad or m.
    - `velocities`, `accelerations`: [k n], or None.
    - `unit_is_known`: True if the data or the user gives the unit of the times.

    Raises DefinitionError for fewer than two rows, times that do not increase, or numbers that are not finite.
    """

    source: str
    joints: tuple[str, ...]
    rows: Sequence[str]
    times: NDArray[np.float64]
    positions: NDArray[np.float64]
    velocities: NDArray[np.float64] | None = None
    accelerations: NDArray[np.float64] | None = None
    unit_is_known: bool = False

    def __post_init__(self) -> None:
        if len(self.times) < 2:
            raise DefinitionError(
                f"{self.source} has {counted(len(self.times), 'row')}: "
                "a motion needs two or more, the first says where it starts"
            )
        self._require_finite("time", self.times[:, None])
        for field in ("position", "velocity", "acceleration"):
            values = self._values(field)
            if values is not None:
                self._require_finite(field, values)
        wrong = np.diff(self.times) <= 0
        if wrong.any():
            row = int(np.argmax(wrong)) + 1
            again = self.times[row] == self.times[row - 1]
            rule = "two rows at one time would be a jump; leave one of them out" if again else "the times must increase"
            raise DefinitionError(
                f"{self.at(row)}: time {self.times[row]:g} s comes after {self.times[row - 1]:g} s: {rule}"
            )
        if self.accelerations is not None and self.velocities is None:
            raise DefinitionError(f"{self.source} has accelerations but no velocities: give both, or neither")

    def at(self, row: int) -> str:
        """Return source and label of a row, by its index from 0."""
        return f"{self.source}, {self.rows[row]}"

    def starting(self, start: float | None) -> Table:
        """Return the table with its first row at a time [s]; None keeps the times.

        Raises DefinitionError if the motion would begin before 0 or far after.
        """
        moved = self if start is None else replace(self, times=self.times - self.times[0] + start)
        first = float(moved.times[0])
        if not 0 <= first <= CLOCK:
            what = "a motion starts at 0 or later" if first < 0 else "this looks like a clock"
            raise DefinitionError(
                f"{self.at(0)}: time {first:g} s: {what}; with `start=0` the table is moved to begin at 0"
            )
        return moved

    def _values(self, field: str) -> NDArray[np.float64] | None:
        return {"position": self.positions, "velocity": self.velocities, "acceleration": self.accelerations}[field]

    def _require_finite(self, field: str, values: NDArray[np.float64]) -> None:
        if not np.all(np.isfinite(values)):
            row, joint = (int(index) for index in np.argwhere(~np.isfinite(values))[0])
            of = "" if field == "time" else f" of {called(joint, self.joints)}"
            raise DefinitionError(f"{self.at(row)}: the {field}{of} must be a finite number")


def columns_of(source: str, names: Sequence[str], joints: Sequence[str] | None) -> list[int]:
    """Return the indices of a table's columns in the order of a robot's joints, matched by names.

    - `source`: origin of the table, for messages.
    - `names`: of the columns.
    - `joints`: the robot's names; None for all columns in their order.

    Columns of other joints are dropped with a DefinitionWarning. Raises DefinitionError for a missing joint, or a name
    that occurs twice.
    """
    _require_distinct(names, f"{source} has")
    if joints is None:
        return list(range(len(names)))
    _require_distinct(joints, "`joints` has")
    places = matched(names, joints)
    absent = [name for name in joints if name not in places]
    if absent == list(joints) and are_numbered(joints):
        return _in_their_order(source, names, joints)
    if absent:
        hint = nearest(absent[0], names) if len(absent) == 1 else f"there are: {quoted(names)}"
        hint = hint if hint.endswith("?") else f"{hint}."
        raise DefinitionError(
            f"{source} lacks the joint{'s' * (len(absent) > 1)} {quoted(absent)}; {hint} "
            f"If the file has other names, list its names of {quoted(joints)}, in this order, as {JOINTS}"
        )
    columns = [places[name] for name in joints]
    others = [name for place, name in enumerate(names) if place not in columns]
    if others:
        verb = "is not a joint of the robot and is" if len(others) == 1 else "are not joints of the robot and are"
        warnings.warn(DefinitionWarning(f"{source}: {quoted(others)} {verb} left out"), stacklevel=2)
    return columns


def _in_their_order(source: str, names: Sequence[str], joints: Sequence[str]) -> list[int]:
    """Columns for joints without names of their own."""
    if len(names) != len(joints):
        raise DefinitionError(
            f"{source} moves {counted(len(names), 'joint')}, {quoted(names)}, but the robot has {len(joints)}, "
            f"which have no names of their own: list the names in the file that move them, in their order, as {JOINTS}"
        )
    if len(joints) > 1:
        warning = (
            f"{source}: the robot's joints have no names of their own, so that the columns {quoted(names)} move "
            f"{quoted(joints)} in this order; to say so, or another order, list the names as {JOINTS}"
        )
        warnings.warn(DefinitionWarning(warning), stacklevel=2)
    return list(range(len(names)))


def _require_distinct(names: Sequence[str], owner: str) -> None:
    for name in names:
        if list(names).count(name) > 1:
            raise DefinitionError(f"{owner} the joint `{name}` more than once")
