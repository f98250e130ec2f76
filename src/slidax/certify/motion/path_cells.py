"""A motion cut into short time cells, with bounds of its derivatives that hold at every instant of a cell."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slidax.core.errors import DefinitionError
from slidax.motions.trajectory import (
    AbstractMotion,
    AbstractPiecewisePolynomial,
    AbstractSmoothMotion,
    Extremes,
    derivative_coefficients,
)

Floats = NDArray[np.float64]

CELL_TRAVEL = 0.06
"""rad or m: largest travel of all joints together in a cell, so that Taylor remainders are a few per cent."""

SHORTEST_CELL, LONGEST_CELL = 0.005, 0.028
"""Limits of a cell's length [s]."""


@dataclass(frozen=True, eq=False)
class PathCells:
    """A motion cut into time cells of equal length. A motion that ends is followed by some time at rest.

    - `period`: h [s]; `per_cell`: periods in a cell.
    - `q`, `dq`, `ddq`, `dddq`: the motion at the centre of each cell [cells n].
    - `speed`, `acceleration`, `jerk`: bounds of |dq|, |ddq| and |dddq| over each cell [cells n].
    - `jump`: sum of the sizes of the acceleration's jumps in each cell [cells n].
    - `pulse`: error of the position after a period if the reference had its mean acceleration throughout that period;
      the largest over the cell's periods [cells n], rad or m.
    - `pieces`: the motion itself.
    - `until`: end of the last cell for a motion without an end [s]. None for a motion that ends at rest: then the last
      cell stands for all later times.
    """

    period: float
    per_cell: int
    q: Floats
    dq: Floats
    ddq: Floats
    dddq: Floats
    speed: Floats
    acceleration: Floats
    jerk: Floats
    jump: Floats
    pulse: Floats
    pieces: AbstractPieces = field(repr=False)
    until: float | None

    @property
    def moving(self) -> int:
        """Number of cells before the arm stays at rest; at most all cells but one."""
        same = np.all(np.concatenate([self.q - self.q[-1], self.dq, self.ddq, self.dddq], axis=1) == 0.0, axis=1)
        return min(int(np.count_nonzero(np.logical_or.accumulate(~same[::-1]))), len(same) - 1)

    @property
    def half(self) -> float:
        """Half the length of a cell [s]."""
        return 0.5 * self.period * self.per_cell

    @property
    def centres(self) -> Floats:
        """Times of the centres [cells], s."""
        return np.asarray((np.arange(len(self.q)) + 0.5) * (self.period * self.per_cell), float)

    @classmethod
    def of(
        cls,
        motion: AbstractMotion,
        period: float,
        *,
        per_cell: int | None = None,
        rest: float = 0.1,
        until: float | None = None,
    ) -> PathCells:
        """Cut a motion into cells.

        - `motion`: the motion, sampled at multiples of the `period` [s].
        - `per_cell`: periods in a cell; None to choose it by the speed of the motion.
        - `rest`: time at rest to add after a motion that ends [s].
        - `until`: time up to which to cut a motion without an end [s].

        Raises DefinitionError as `pieces_of` does.
        """
        pieces = pieces_of(motion, until)
        per_cell = per_cell or pieces.per_cell(period)
        ends = isinstance(pieces, Pieces)
        end = float(pieces.knots[-1]) + (rest if ends else 0.0)
        count = int(np.ceil(end / (period * per_cell) - 1e-9))
        ticks = np.asarray(np.arange(count * per_cell + 1) * period, float)
        centres = np.asarray((np.arange(count) + 0.5) * (period * per_cell), float)
        q, dq, ddq, dddq = pieces.at(centres)
        speed, acceleration, jerk = pieces.sizes(ticks, per_cell)
        positions, velocities = pieces.at(ticks)[:2]
        miss = np.diff(positions, axis=0) - 0.5 * period * (velocities[1:] + velocities[:-1])
        pulse = np.abs(miss).reshape(count, per_cell, -1).max(axis=1)
        return cls(
            period,
            per_cell,
            q,
            dq,
            ddq,
            dddq,
            speed,
            acceleration,
            jerk,
            pieces.jumps(count, period * per_cell),
            pulse,
            pieces,
            None if ends else end,
        )


class AbstractPieces(ABC):
    """A motion from time 0, with bounds of its derivatives.

    - `knots`: times at which the acceleration may jump, in increasing order; the last is the end of the motion [s].
    """

    knots: Floats

    @abstractmethod
    def at(self, t: Floats) -> list[Floats]:
        """Return positions and three derivatives at the times t, each [times n]."""

    @abstractmethod
    def jumps(self, count: int, length: float) -> Floats:
        """Return the sum of the sizes of the acceleration's jumps in each cell [cells n], rad/s² or m/s².

        - `count`, `length`: number of cells, and their length [s].
        """

    @abstractmethod
    def sizes(self, ticks: Floats, per_cell: int) -> list[Floats]:
        """Return bounds of |dq|, |ddq| and |dddq| in each cell, each [cells n].

        - `ticks`: sample times, from the start of the first cell to the end of the last one [s].
        - `per_cell`: periods in a cell.
        """

    @abstractmethod
    def extremes(self, order: int) -> Extremes:
        """Return bounds of each joint's least and largest value of a derivative over the motion, with their times.

        - `order`: order of the derivative; 0 for the position.
        """

    def per_cell(self, period: float) -> int:
        """Return the number of periods in a cell, chosen by the speed of the motion."""
        t = np.linspace(self.knots[0], self.knots[-1], 400)
        fastest = float(np.max(np.sum(np.abs(self.at(t)[1]), axis=1)))
        length = np.clip(CELL_TRAVEL / max(fastest, 1e-9), SHORTEST_CELL, LONGEST_CELL)
        return max(1, round(float(length) / period))


def pieces_of(motion: AbstractMotion, until: float | None = None) -> AbstractPieces:
    """Return a motion with bounds of its derivatives, for `PathCells`.

    - `until`: time up to which a motion without an end is bounded [s]; not used for a piecewise polynomial.

    Raises DefinitionError for a motion of another kind, for one that starts before 0 s, and for a motion without an end
    if `until` is None.
    """
    if isinstance(motion, AbstractPiecewisePolynomial):
        return Pieces.of(motion)
    if not isinstance(motion, AbstractSmoothMotion):
        raise DefinitionError(
            f"a bound along a motion needs polynomials, a sinusoid or exponentials; got `{type(motion).__name__}`: set "
            "`trajectory.kind` to `quintic`, `minimum_jerk`, `csv` or `joint_trajectory`"
        )
    if until is None:
        raise DefinitionError(
            f"a motion of kind `{type(motion).__name__}` has no end: give `until`, the time [s] up to which to bound it"
        )
    return SmoothPieces(motion, np.array([0.0, until]))


@dataclass(frozen=True, eq=False)
class SmoothPieces(AbstractPieces):
    """A smooth motion from time 0 to the last of the `knots` [s]. Before time 0 it moves with constant velocity."""

    motion: AbstractSmoothMotion
    knots: Floats

    def at(self, t: Floats) -> list[Floats]:
        return [self.motion.derivative(t, order) for order in range(4)]

    def jumps(self, count: int, length: float) -> Floats:
        first = np.abs(self.motion.derivative(np.zeros(1), 2))
        return np.concatenate([first, np.zeros((count - 1, first.shape[1]))])

    def sizes(self, ticks: Floats, per_cell: int) -> list[Floats]:
        results = []
        for order in (1, 2, 3):
            value, apart = np.abs(self.motion.derivative(ticks, order)), self._apart(ticks, order)
            value = np.maximum(value[:-1], value[1:]) + apart
            results.append(value.reshape(-1, per_cell, value.shape[1]).max(axis=1))
        return results

    def extremes(self, order: int) -> Extremes:
        t = np.linspace(self.knots[0], self.knots[-1], max(2, round((self.knots[-1] - self.knots[0]) / FINE) + 1))
        values, apart = self.motion.derivative(t, order), self._apart(t, order).max(axis=0)
        low, high = values.argmin(axis=0), values.argmax(axis=0)
        return Extremes(values.min(axis=0) - apart, values.max(axis=0) + apart, t[low], t[high])

    def _apart(self, ticks: Floats, order: int) -> Floats:
        """Bound of a derivative's departure from its chord between two ticks: Δ²/8 times its second derivative."""
        return np.asarray(np.diff(ticks)[:, None] ** 2 / 8.0 * self.motion.largest_derivative(ticks[:-1], order + 2))


FINE = 1e-3
"""s: spacing of the times at which extremes of a smooth motion are computed."""


@dataclass(frozen=True, eq=False)
class Pieces(AbstractPieces):
    """A piecewise polynomial motion, at rest outside its knots.

    - `knots`: times at which the k pieces begin and end [k+1], s.
    - `coefficients`: of each piece's polynomial in the time since the piece began, highest power first [powers k n].
    """

    knots: Floats
    coefficients: Floats
    motion: AbstractPiecewisePolynomial

    @classmethod
    def of(cls, motion: AbstractPiecewisePolynomial) -> Pieces:
        """Return the pieces of a motion.

        Raises DefinitionError if the motion starts before 0 s.
        """
        knots, coefficients = np.asarray(motion.times, float), np.asarray(motion.coefficients, float)
        if knots[0] < -1e-12:
            raise DefinitionError(f"the motion must not start before 0 s; got {knots[0]:g} s")
        return cls(knots, coefficients, motion)

    def extremes(self, order: int) -> Extremes:
        return self.motion.extremes(order)

    def at(self, t: Floats, last: bool = False) -> list[Floats]:
        """Return positions and three derivatives at the times t, each [times n].

        - `last`: at a knot, True for the values of the piece that ends there; False for the piece that begins.
        """
        piece = np.searchsorted(self.knots, t, side="left" if last else "right")
        piece = np.clip(piece - 1, 0, len(self.knots) - 2)
        inside = (t >= self.knots[0]) & ((t <= self.knots[-1]) if last else (t < self.knots[-1]))
        local = np.clip(t, self.knots[0], self.knots[-1]) - self.knots[piece]
        values = []
        for order in range(4):
            value = _horner(derivative_coefficients(self.coefficients, order)[:, piece], local)
            values.append(value if order == 0 else np.where(inside[:, None], value, 0.0))
        return values

    def jumps(self, count: int, length: float) -> Floats:
        before, after = self.at(self.knots, last=True)[2], self.at(self.knots)[2]
        # Before the first knot the motion is at rest.
        before[0] = 0.0
        size = np.abs(after - before)
        size[size < 1e-7] = 0.0
        result = np.zeros((count, size.shape[1]))
        np.add.at(result, np.minimum((self.knots / length).astype(int), count - 1), size)
        return result

    def sizes(self, ticks: Floats, per_cell: int) -> list[Floats]:
        """Return bounds of |dq|, |ddq| and |dddq| in each cell [cells n].

        Between two nodes, which are ticks and knots, a derivative departs from its chord by at most Δ²/8 times the
        largest second derivative.
        """
        nodes = np.unique(np.concatenate([ticks, self.knots[(self.knots > ticks[0]) & (self.knots < ticks[-1])]]))
        widths = np.diff(nodes)[:, None]
        begin, end = self.at(nodes[:-1]), self.at(nodes[1:], last=True)
        middle = 0.5 * (nodes[1:] + nodes[:-1])
        piece = np.clip(np.searchsorted(self.knots, middle) - 1, 0, len(self.knots) - 2)
        inside = (middle > self.knots[0]) & (middle < self.knots[-1])
        local = [np.clip(side - self.knots[piece], 0.0, None) for side in (nodes[:-1], nodes[1:])]
        begins = np.searchsorted(nodes[:-1], ticks[:-1:per_cell])
        results = []
        for order in (1, 2, 3):
            # A bound of the second derivative: its values at the ends, plus its departure from its own chord.
            bend = np.zeros_like(begin[0])
            for extra, factor in ((2, 1.0), (4, 1.0 / 8.0)):
                powers = derivative_coefficients(self.coefficients, order + extra)[:, piece]
                ends = np.maximum(*(np.abs(_horner(powers, side)) for side in local))
                bend = bend + factor * widths ** (extra - 2) * ends
            bend = np.where(inside[:, None], bend, 0.0)
            value = np.maximum(np.abs(begin[order]), np.abs(end[order])) + widths**2 / 8.0 * bend
            results.append(np.maximum.reduceat(value, begins, axis=0))
        return results


def _horner(powers: Any, local: Floats) -> Floats:
    value = powers[0]
    for power in powers[1:]:
        value = value * local[:, None] + power
    return np.asarray(value)
