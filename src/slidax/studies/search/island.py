"""One CMA-ES of several that search side by side."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from slidax._errors import DefinitionError

FAR = 10.0
"""Penalty of a point outside the cube, per squared distance, in spreads of the values."""


def population(dimension: int, lanes: int = 8) -> int:
    """Population of each generation: CMA-ES's own number, filled up to whole vectors.

    - `dimension`: of the cube.
    - `lanes`: runs that are computed side by side.
    """
    return -(-(4 + math.floor(3 * math.log(dimension))) // lanes) * lanes


class Island:
    """CMA-ES (N. Hansen, A. Ostermeier, Evol. Comput. 9, 2001) in the unit cube, by the package `cmaes`.

    Points beyond a face are asked for at the nearest point inside, with a penalty that grows with the distance, so that
    the faces and corners, where the worst cases often are, can be reached.

    - `start`: its first mean [dimension].
    - `size`: its first standard deviation.
    - `points`: of each generation.
    - `seed`: of its random numbers.

    Raises DefinitionError if `cmaes` is not installed.
    """

    def __init__(self, start: np.ndarray, size: float, points: int, seed: int) -> None:
        cma = _cmaes().CMA
        self._search = cma(mean=np.array(start, float), sigma=size, seed=seed, population_size=points)
        self._points: list[np.ndarray] = []

    def ask(self) -> np.ndarray:
        """The points of the next generation [points dimension], also such outside of the cube."""
        self._points = [self._search.ask() for _ in range(self._search.population_size)]
        return np.array(self._points)

    def tell(self, values: np.ndarray) -> None:
        """Set the values of the last generation.

        - `values`: at the nearest points inside [points]; of those that are +∞ each is as bad as the other.
        """
        good = values[np.isfinite(values)]
        spread = float(np.ptp(good)) if good.size else 1.0
        worst = float(good.max()) if good.size else 0.0
        points = np.array(self._points)
        beyond = np.sum((points - np.clip(points, 0.0, 1.0)) ** 2, axis=1)
        told = np.where(np.isfinite(values), values, worst + (spread or 1.0)) + FAR * (spread or 1e-9) * beyond
        self._search.tell(list(zip(self._points, map(float, told), strict=True)))

    @property
    def settled(self) -> bool:
        """True if it will not find anything more."""
        return bool(self._search.should_stop())


def require_cmaes() -> None:
    """Raises DefinitionError if `cmaes` is not installed."""
    _cmaes()


def _cmaes() -> Any:
    try:
        import cmaes
    except ImportError:
        raise DefinitionError("a search needs cmaes, which is not installed: pip install 'slidax[studies]'") from None
    return cmaes
