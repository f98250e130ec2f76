"""A motion as rows of numbers, checked: what a file says before it is a trajectory."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from slidax._errors import DefinitionError, nearest

from .motion_limits import called

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

    Raises DefinitionError if there are fewer than two rows, the times do not increase or something is not finite.
    """

    source: str
    joints: tuple[str, ...]
    rows: Sequence[str]
    times: NDArray[np.float64]
    positions: NDArray[np.float64]
    velocities: NDArray[np.float64] | None = None
    accelerations: NDArray[np.float64] | None = None

    def __post_init__(self) -> None:
        if len(self.times) < 2:
            raise DefinitionError(
                f"{self.source} has {len(self.times)} rows: a motion needs two or more, the first says where it starts"
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

    def of(self, joints: Sequence[str] | None) -> Table:
        """The table with its columns in the order of a robot's joints.

        - `joints`: the robot's names; None for the order of the table.

        Raises DefinitionError if a name is missing, unknown or twice there.
        """
        _require_distinct(self.joints, f"{self.source} has")
        if joints is None:
            return self
        wanted = list(joints)
        _require_distinct(wanted, "`joints` has")
        for name in self.joints:
            if name not in wanted:
                raise DefinitionError(
                    f"{self.source} has the joint `{name}`, which the robot does not have; {nearest(name, wanted)}"
                )
        for name in wanted:
            if name not in self.joints:
                raise DefinitionError(f"{self.source} lacks the joint `{name}`; {nearest(name, self.joints)}")
        order = [self.joints.index(name) for name in wanted]
        return replace(
            self,
            joints=tuple(wanted),
            positions=self.positions[:, order],
            velocities=None if self.velocities is None else self.velocities[:, order],
            accelerations=None if self.accelerations is None else self.accelerations[:, order],
        )

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


def _require_distinct(names: Sequence[str], owner: str) -> None:
    for name in names:
        if list(names).count(name) > 1:
            raise DefinitionError(f"{owner} the joint `{name}` more than once")
