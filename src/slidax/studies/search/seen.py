"""Points that a search has evaluated, and its remaining budget."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np

from slidax._errors import DefinitionError, shown

from .found import Found, Stop, apart

Objective = Callable[[np.ndarray], np.ndarray]
"""Function of points in the unit cube [points dimension] to their values [points]; nonfinite values count as +∞."""


class Seen:
    """Evaluates the objective, and records every point and value.

    - `evaluations`: largest number of points.
    - `seconds`: no batch begins after so many; None: any number.
    - `enough`: value below which the search ends; None: no such value.
    """

    def __init__(self, objective: Objective, evaluations: int, seconds: float | None, enough: float | None) -> None:
        self._objective = objective
        self._most = evaluations
        self._until = None if seconds is None else time.monotonic() + seconds
        self._enough = enough
        self._points: list[np.ndarray] = []
        self._values: list[np.ndarray] = []
        self._history: list[tuple[int, float]] = []
        self.evaluations = 0
        self.lowest = np.inf

    @property
    def over(self) -> Stop | None:
        """The reason to end the search now; None to go on."""
        if self._enough is not None and self.lowest < self._enough:
            return "enough"
        if self.evaluations >= self._most:
            return "evaluations"
        if self._until is not None and time.monotonic() >= self._until:
            return "seconds"
        return None

    @property
    def left(self) -> int:
        """Number of evaluations that are left."""
        return self._most - self.evaluations

    def ask(self, points: np.ndarray) -> np.ndarray:
        """Evaluate points in one batch; +∞ for each beyond the budget.

        - `points`: of the cube [points dimension]; points outside are moved to the nearest point inside.
        """
        wanted = np.clip(points[: self.left], 0.0, 1.0)
        values = np.full(len(points), np.inf)
        if len(wanted):
            got = np.asarray(self._objective(wanted), float)
            if got.shape != (len(wanted),):
                raise DefinitionError(f"an objective gives one number for each point, {len(wanted)}; got {got.shape}")
            values[: len(wanted)] = np.where(np.isfinite(got), got, np.inf)
            self._points.append(wanted)
            self._values.append(values[: len(wanted)])
            self.evaluations += len(wanted)
            self.lowest = min(self.lowest, float(values.min()))
            self._history.append((self.evaluations, self.lowest))
        return values

    @property
    def all(self) -> tuple[np.ndarray, np.ndarray]:
        """Every point [points dimension] and its value [points]."""
        return np.concatenate(self._points), np.concatenate(self._values)

    def result(self, keep: int, distance: float, stop: Stop) -> Found:
        """The lowest points.

        - `keep`: their largest number.
        - `distance`: their smallest distance from each other.
        - `stop`: reason for the end of the search.
        """
        points, values = self.all
        chosen = apart(points, values, keep, distance)
        chosen = chosen[np.isfinite(values[chosen])]
        return Found(points[chosen], values[chosen], self.evaluations, np.array(self._history), stop)


def require_budget(dimension: int, evaluations: int) -> None:
    """Raise DefinitionError if the cube's dimension or the number of evaluations is less than 1."""
    if dimension < 1:
        raise DefinitionError(f"a search needs at least one number that is uncertain; got {shown(dimension)}")
    if evaluations < 1:
        raise DefinitionError(f"a search needs at least one evaluation; got {shown(evaluations)}")
