"""Extremes of piecewise polynomials."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

NEGLIGIBLE = 1e-13
"""A power that adds less than this part of its piece is rounding, and gives no roots."""


class Extremes(NamedTuple):
    """Least and largest value of each joint [n], and their times [n], s."""

    least: NDArray[np.float64]
    largest: NDArray[np.float64]
    when_least: NDArray[np.float64]
    when_largest: NDArray[np.float64]

    @property
    def size(self) -> NDArray[np.float64]:
        """Largest absolute value of each joint [n]."""
        return np.maximum(-self.least, self.largest)


def derived(coefficients: NDArray[np.float64], order: int) -> NDArray[np.float64]:
    """Return the coefficients of a derivative, at least one power.

    - `coefficients`: highest power first, [powers pieces n].
    """
    for _ in range(order):
        degree = len(coefficients) - 1
        if degree == 0:
            return np.zeros_like(coefficients)
        coefficients = coefficients[:-1] * np.arange(degree, 0, -1)[:, None, None]
    return coefficients


def extremes(times: NDArray[np.float64], coefficients: NDArray[np.float64], order: int) -> Extremes:
    """Return the extremes of a derivative between the first and the last knot.

    - `times`: knots [k], s.
    - `coefficients`: highest power first, [powers k-1 n].
    - `order`: order of the derivative; 0 for the polynomials themselves.
    """
    from scipy.interpolate import PPoly

    derivative = derived(coefficients, order)
    widths = np.diff(times)[:, None]
    ends = derivative[0]
    for power in derivative[1:]:
        ends = ends * widths + power
    slope = derived(derivative, 1)
    degrees = np.arange(len(slope) - 1, -1, -1)[:, None, None]
    share = np.abs(slope) * widths**degrees
    slope = np.where(share <= NEGLIGIBLE * share.max(axis=0), 0.0, slope)
    rows = []
    for joint in range(derivative.shape[2]):
        turns = PPoly(slope[:, :, joint], times).roots(discontinuity=False, extrapolate=False)
        # A piece with slope zero throughout is reported as NaN: its ends say all.
        turns = turns[np.isfinite(turns)]
        when = np.concatenate([times[:-1], times[1:], turns])
        there = PPoly(derivative[:, :, joint], times)(turns)
        value = np.concatenate([derivative[-1, :, joint], ends[:, joint], there])
        low, high = int(np.argmin(value)), int(np.argmax(value))
        rows.append((value[low], value[high], when[low], when[high]))
    return Extremes(*np.array(rows).T)
