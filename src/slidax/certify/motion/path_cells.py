"""A motion cut into short cells of time, with bounds of its derivatives that hold at every instant of a cell."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slidax.core.errors import DefinitionError
from slidax.motions.trajectory import AbstractMotion, AbstractPiecewisePolynomial, derivative_coefficients

Floats = NDArray[np.float64]

CELL_TRAVEL = 0.06
"""rad or m: all joints together travel at most this far in a cell, so that its remainders are some per cent."""

SHORTEST_CELL, LONGEST_CELL = 0.005, 0.028
"""s."""


@dataclass(frozen=True, eq=False)
class PathCells:
    """A motion in N cells of equal length, followed by rest.

    - `period`: h [s]; `per_cell`: periods in a cell.
    - `q`, `dq`, `ddq`, `dddq`: the motion at the centre of each cell [N n].
    - `speed`, `acceleration`, `jerk`: largest sizes in each cell, for all of its times [N n].
    - `jump`: sum of the acceleration's jumps in each cell [N n], at knots.
    - `pulse`: largest miss of the position after a period under the mean acceleration [N n], rad or m.
    - `proved`: True if the sizes hold between the samples; False for a motion that is known at samples only.
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
    proved: bool

    @property
    def moving(self) -> int:
        """Number of cells until the arm is at rest for good, or one fewer than all cells."""
        same = np.all(np.concatenate([self.q - self.q[-1], self.dq, self.ddq, self.dddq], axis=1) == 0.0, axis=1)
        return min(int(np.count_nonzero(np.logical_or.accumulate(~same[::-1]))), len(same) - 1)

    @property
    def half(self) -> float:
        """Half the length of a cell [s]."""
        return 0.5 * self.period * self.per_cell

    @property
    def centres(self) -> Floats:
        """Times of the centres [N], s."""
        return np.asarray((np.arange(len(self.q)) + 0.5) * (self.period * self.per_cell), float)

    @classmethod
    def of(cls, motion: AbstractMotion, period: float, *, per_cell: int | None = None, rest: float = 0.1) -> PathCells:
        """Cut a motion into cells.

        - `motion`: ends at rest; the sample times are the multiples of the period.
        - `per_cell`: periods in a cell; None: by the speed of the motion.
        - `rest`: time at rest after it that is looked at [s].

        Raises DefinitionError if the motion is no piecewise polynomial, or does not end.
        """
        if not isinstance(motion, AbstractPiecewisePolynomial):
            raise DefinitionError(
                f"a bound along a motion needs piecewise polynomials, as from `Tabulated`; got {type(motion).__name__}"
            )
        pieces = Pieces.of(motion)
        per_cell = per_cell or pieces.per_cell(period)
        end = float(pieces.knots[-1]) + rest
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
            True,
        )


@dataclass(frozen=True, eq=False)
class Pieces:
    """A piecewise polynomial motion, at rest outside of its knots.

    - `knots`: [k+1], s; `coefficients`: highest power first, [powers k n].
    """

    knots: Floats
    coefficients: Floats

    @classmethod
    def of(cls, motion: AbstractPiecewisePolynomial) -> Pieces:
        """The pieces of a motion, from time 0."""
        knots, coefficients = np.asarray(motion.times, float), np.asarray(motion.coefficients, float)
        if knots[0] < -1e-12:
            raise DefinitionError(f"the motion must not start before 0 s; got {knots[0]:g} s")
        return cls(knots, coefficients)

    def at(self, t: Floats, last: bool = False) -> list[Floats]:
        """Return positions and three derivatives [N n] at the times.

        - `last`: at a knot, take the piece that ends there, and not the one that begins.
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

    def per_cell(self, period: float) -> int:
        """Return a number of periods for a cell, by the speed of the motion."""
        t = np.linspace(self.knots[0], self.knots[-1], 400)
        fastest = float(np.max(np.sum(np.abs(self.at(t)[1]), axis=1)))
        length = np.clip(CELL_TRAVEL / max(fastest, 1e-9), SHORTEST_CELL, LONGEST_CELL)
        return max(1, round(float(length) / period))

    def jumps(self, count: int, length: float) -> Floats:
        """Return the sum of the acceleration's jumps in each cell [N n]."""
        before, after = self.at(self.knots, last=True)[2], self.at(self.knots)[2]
        # The first knot has rest before it.
        before[0] = 0.0
        size = np.abs(after - before)
        size[size < 1e-7] = 0.0
        result = np.zeros((count, size.shape[1]))
        np.add.at(result, np.minimum((self.knots / length).astype(int), count - 1), size)
        return result

    def sizes(self, ticks: Floats, per_cell: int) -> list[Floats]:
        """Return bounds of |dq|, |ddq| and |dddq| in each cell [N n].

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
        cell = np.minimum((middle / (ticks[1] - ticks[0]) / per_cell).astype(int), (len(ticks) - 1) // per_cell - 1)
        results = []
        for order in (1, 2, 3):
            # The second derivative is itself at most its values at the ends and its own departure from its chord.
            bend = np.zeros_like(begin[0])
            for extra, factor in ((2, 1.0), (4, 1.0 / 8.0)):
                powers = derivative_coefficients(self.coefficients, order + extra)[:, piece]
                ends = np.maximum(*(np.abs(_horner(powers, side)) for side in local))
                bend = bend + factor * widths ** (extra - 2) * ends
            bend = np.where(inside[:, None], bend, 0.0)
            value = np.maximum(np.abs(begin[order]), np.abs(end[order])) + widths**2 / 8.0 * bend
            largest = np.zeros(((len(ticks) - 1) // per_cell, value.shape[1]))
            np.maximum.at(largest, cell, value)
            results.append(largest)
        return results


def _horner(powers: Any, local: Floats) -> Floats:
    value = powers[0]
    for power in powers[1:]:
        value = value * local[:, None] + power
    return np.asarray(value)
