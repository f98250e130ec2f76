"""Rows that a study evaluates batch by batch."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from slidax.scenarios.family import Family

from .cases import Values
from .runner import Runner
from .table import Columns

BELOW_ONE = np.nextafter(1.0, 0.0)
"""Largest coordinate of a point of the cube, whose upper faces do not belong to it."""


class Asked:
    """Evaluates points of the unit cube and keeps their rows, numbered in the order of evaluation.

    - `runner`: turns values into rows.
    - `family`: of the rows; its space turns points into values.
    """

    def __init__(self, runner: Runner, family: Family) -> None:
        self.runner = runner
        self.family = family
        self.rows = 0
        self._parts: list[Columns] = []
        self._values: list[Values] = []

    def points(self, cube: np.ndarray) -> Columns:
        """Return the rows of points [rows, dimensions] in [0, 1]."""
        return self.values(self.family.space.values(np.clip(cube, 0.0, BELOW_ONE)))

    def values(self, values: Mapping[str, Any]) -> Columns:
        """Return the rows of values by path, with the row first."""
        columns = self.runner.rows(self.rows, values)
        self.rows += len(columns["row"])
        self._parts.append(columns)
        self._values.append(values)
        return columns

    @property
    def table(self) -> Columns:
        """All rows, in the order of evaluation."""
        return {name: np.concatenate([part[name] for part in self._parts]) for name in self._parts[0]}

    def values_of(self, row: int) -> dict[str, Any]:
        """Return the values of a row, by path."""
        for values in self._values:
            rows = len(next(iter(values.values())))
            if row < rows:
                return {path: array[row] for path, array in values.items()}
            row -= rows
        raise IndexError(row)

    def collected(self) -> dict[str, Any]:
        """Write all rows as one table, if they are kept, and return the fields of `AbstractTableResult`."""
        store = self.runner.store
        return {
            "family": self.family,
            "table": self.table,
            "path": None if store is None else store.finish(self.rows),
            "computed": self.runner.computed,
            "seconds": self.runner.seconds,
        }
