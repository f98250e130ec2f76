"""A motion as rows of numbers, checked: what a file says before it is a trajectory."""

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
    """Positions over time, perhaps with velocities, perhaps with accelerations too.

    - `source`: what it was read from, for messages.
    - `joints`: names of the joints; none for a table of numbers alone.
    - `rows`: what each row is called in messages, such as `line 7`.
    - `times`: [k], s.
    - `positions`: [k n], rad or m.
    - `velocities`, `accelerations`: [k n], or None.
    - `unit_is_known`: whether the data, or the user, says in which unit the times are.

    Raises DefinitionError if there are fewer than two rows, the times do not increase or something is not finite.
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
        """A row with where it stands.

        - `row`: its number from 0.
        """
        return f"{self.source}, {self.rows[row]}"

    def starting(self, start: float | None) -> Table:
        """The table with its first row at a time.

        - `start`: [s]; None leaves the times as they are.

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
    """The columns of a table in the order of a robot's joints, found by their names.

    - `source`: what the table was read from, for messages.
    - `names`: of its columns.
    - `joints`: the robot's names; None for all columns in the order of the table.

    Columns of joints that the robot does not have are left out, with a DefinitionWarning. Raises DefinitionError if a
    joint is missing, or a name stands there twice.
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
    """Columns for joints that have no names of their own."""
    if len(names) != len(joints):
        raise DefinitionError(
            f"{source} moves {counted(len(names), 'joint')}, {quoted(names)}, but the robot has {len(joints)}, "
            f"which have no names of their own: list the names in the file that move them, in their order, as {JOINTS}"
        )
    if len(joints) > 1:
        said = (
            f"{source}: the robot's joints have no names of their own, so that the columns {quoted(names)} move "
            f"{quoted(joints)} in this order; to say so, or another order, list the names as {JOINTS}"
        )
        warnings.warn(DefinitionWarning(said), stacklevel=2)
    return list(range(len(names)))


def _require_distinct(names: Sequence[str], owner: str) -> None:
    for name in names:
        if list(names).count(name) > 1:
            raise DefinitionError(f"{owner} the joint `{name}` more than once")
