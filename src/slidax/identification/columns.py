"""The columns of a table that make a log."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from .log import Log


@dataclass(frozen=True)
class Columns:
    """Where a table has its times and, for each quantity that it has, the joints in the arm's order.

    - `time`: name of the column.
    - `of`: names of columns by quantity.
    - `scale`: for each column that is used, what one of its units is in s, rad, rad/s or N m.
    - `notes`: what was left out or converted.
    """

    time: str
    of: dict[str, list[str]]
    scale: dict[str, float]
    notes: tuple[str, ...] = ()

    @property
    def titles(self) -> list[str]:
        """The titles of all columns that are used."""
        return [self.time, *(title for titles in self.of.values() for title in titles)]

    def log(
        self, source: str, joints: Sequence[str], table: Mapping[str, np.ndarray], notes: Sequence[str] = ()
    ) -> Log:
        """Return the log in a table that has these columns.

        - `source`: what was read, for messages.
        - `joints`: the arm's joints, in its order.
        - `table`: each column by its title.
        - `notes`: of the reader, before those of the columns.
        """
        values = {
            name: np.stack([table[title] * self.scale.get(title, 1.0) for title in titles], axis=1)
            for name, titles in self.of.items()
        }
        times = table[self.time] * self.scale.get(self.time, 1.0)
        if len(times) and abs(times[0]) > 1e6:
            # Since 1970, say: what matters is the time since the first sample.
            times = (table[self.time] - table[self.time][0]) * self.scale.get(self.time, 1.0)
        return Log(source, tuple(joints), times, values["q"], values["tau"], values.get("dq"), (*notes, *self.notes))
