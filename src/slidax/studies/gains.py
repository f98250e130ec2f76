"""Candidates for gains, each judged on the same cases."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from slidax._errors import DefinitionError, nearest, plain
from slidax.scenarios.uncertainty import Space

from .asked import BELOW_ONE, Asked
from .cases import Values
from .predicate import Predicate
from .search import Judged
from .table import Columns


class OnCases:
    """Evaluates points of the gains' cube on the same cases.

    - `request`: runs rows.
    - `gains`: turns points into gains.
    - `cases`: values by path of each case.
    - `aims`: keys of metrics, the lower the better; of a candidate their mean over the cases counts.
    - `holds`: what must hold in every case.
    - `margin`: the least margin that every case must have.
    """

    def __init__(
        self,
        request: Asked,
        gains: Space,
        cases: Values,
        aims: Sequence[str],
        holds: Sequence[Predicate],
        margin: float,
    ) -> None:
        self.evaluator = request
        self.gains = gains
        self.cases = cases
        self.aims = tuple(aims)
        self.holds = tuple(holds)
        self.margin = margin

    @property
    def each(self) -> int:
        """Number of cases."""
        return len(next(iter(self.cases.values()))) if self.cases else 1

    def judge(self, cube: np.ndarray) -> Judged:
        """The aims, and by how much the worst case misses what must hold.

        - `cube`: candidates [candidates gains], in [0, 1].
        """
        return judged(self.rows(cube, self.cases), self.each, self.aims, self.holds, self.margin)

    def rows(self, cube: np.ndarray, cases: Values) -> Columns:
        """The rows of each candidate on each case, the candidates one after the other.

        - `cube`: candidates [candidates gains], in [0, 1].
        - `cases`: values by path of each case.
        """
        gains = self.gains.values(np.clip(cube, 0.0, BELOW_ONE))
        each = len(next(iter(cases.values()))) if cases else 1
        wide = {path: np.repeat(array, each, axis=0) for path, array in gains.items()}
        same = {path: np.concatenate([array] * len(cube)) for path, array in cases.items()}
        return self.evaluator.values({**same, **wide})


def judged(columns: Columns, each: int, aims: Sequence[str], holds: Sequence[Predicate], margin: float) -> Judged:
    """Return the aims of candidates, and the violation of their conditions, from their rows.

    - `columns`: of all candidates, one after the other.
    - `each`: how many rows each has.
    - `aims`, `holds`, `margin`: as in `OnCases`.

    Raises DefinitionError if there is no such metric.
    """
    for aim in aims:
        if aim not in columns:
            raise DefinitionError(f"there is no metric `{plain(aim)}`; {nearest(aim, columns)}", where="aims")
    means = np.stack([columns[aim].reshape(-1, each).mean(axis=1) for aim in aims], axis=1)
    failing = np.zeros(len(columns["outcome"]))
    for item in holds:
        failing += ~item.holds(columns)
    # So many that fail, and by how much: both lead the search to where none does.
    short = np.where(np.isfinite(columns["margin"]), margin - columns["margin"], -np.inf)
    count = failing.reshape(-1, each).sum(axis=1)
    return Judged(means, np.where(count > 0, count + np.maximum(0.0, _most(short, each)), _most(short, each)))


def point_of_own(space: Space) -> np.ndarray:
    """The point of the cube that is the scenario's own values, or nearest to them; the middle where it has none.

    - `space`: of numbers, whose values rise with their coordinates.
    """
    low, high = np.zeros(space.dimensions), np.ones(space.dimensions)
    for _ in range(50):
        middle = 0.5 * (low + high)
        rises = _below_own(space, middle)
        low, high = np.where(rises, middle, low), np.where(rises, high, middle)
    known = np.concatenate([np.full(width, space.leaves[path].own is not None) for path, width in space.widths.items()])
    return np.where(known, 0.5 * (low + high), 0.5)


def _below_own(space: Space, point: np.ndarray) -> np.ndarray:
    values, result = space.values(np.clip(point, 0.0, BELOW_ONE)[None]), []
    for path, width in space.widths.items():
        own = space.leaves[path].own
        if own is None:
            result.append(np.zeros(width, bool))
            continue
        value = values[path][0]
        wide = np.broadcast_shapes(np.shape(value), np.shape(own))
        below = np.broadcast_to(value, wide) - np.broadcast_to(own, wide)
        result.append(below.reshape(-1) < 0 if below.size == width else np.full(width, below.mean() < 0))
    return np.concatenate(result)


def _most(numbers: np.ndarray, each: int) -> np.ndarray:
    most: np.ndarray = numbers.reshape(-1, each).max(axis=1)
    # Without an envelope there is no margin that could be missed.
    return np.where(np.isfinite(most), most, -1.0)
