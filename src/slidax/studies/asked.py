"""The rows that a search asks for, one batch after the other."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from slidax.scenarios.uncertainty import Space

from .cases import Values
from .runner import Runner
from .table import Columns

BELOW_ONE = np.nextafter(1.0, 0.0)
"""The largest coordinate of a point of the cube, whose upper faces do not belong to it."""


class Asked:
    """Runs points of the unit cube, and keeps what came of them; a row's number says when it was asked for.

    - `runner`: turns values into rows.
    - `space`: turns points into values.
    """

    def __init__(self, runner: Runner, space: Space) -> None:
        self.runner = runner
        self.space = space
        self.rows = 0
        self._parts: list[Columns] = []
        self._values: list[Values] = []

    def points(self, cube: np.ndarray) -> Columns:
        """The rows of points.

        - `cube`: [rows dimensions], in [0, 1].
        """
        return self.values(self.space.values(np.clip(cube, 0.0, BELOW_ONE)))

    def values(self, values: Mapping[str, Any]) -> Columns:
        """The rows of values.

        - `values`: by path, with the row first.
        """
        columns = self.runner.rows(self.rows, values)
        self.rows += len(columns["row"])
        self._parts.append(columns)
        self._values.append(values)
        return columns

    @property
    def table(self) -> Columns:
        """All rows, in the order in which they were asked for."""
        return {name: np.concatenate([part[name] for part in self._parts]) for name in self._parts[0]}

    def values_of(self, row: int) -> dict[str, Any]:
        """The values of one row, by path.

        - `row`: its number.
        """
        for values in self._values:
            rows = len(next(iter(values.values())))
            if row < rows:
                return {path: array[row] for path, array in values.items()}
            row -= rows
        raise IndexError(row)

    def finish(self) -> Any:
        """Writes all rows as one table, and gives its path; None if they are not kept."""
        store = self.runner.store
        return None if store is None else store.finish(self.rows)
