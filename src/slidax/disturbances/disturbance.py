"""Base class, sum and scaling of disturbances."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from slidax.parts import AbstractPart, DefinitionError, Scalar, State, Vector, parameter, piece

Floats: TypeAlias = NDArray[np.floating[Any]]


@dataclass(frozen=True, eq=False)
class Samples:
    """States at samples a period apart; over each period a joint's velocity goes from one value to the next.

    - `period`: h [s].
    - `t`: beginning of each period [N], s.
    - `q`, `dq`: positions and velocities at that time [N n].
    """

    period: float
    t: Floats
    q: Floats
    dq: Floats

    @property
    def turn(self) -> Floats:
        """|Δq̇| over each period [N n], rad/s or m/s; after the last sample as before it."""
        steps = np.abs(np.diff(self.dq, axis=0, append=self.dq[-1:]))
        return np.concatenate([steps[:-1], steps[-2:-1] if len(steps) > 1 else steps])

    @property
    def way(self) -> Floats:
        """Largest distance that a joint moves in each period [N n], rad or m."""
        return (np.abs(self.dq) + self.turn) * self.period

    def jumps(self, first: Any, last: Any) -> NDArray[np.bool_]:
        """True for each period in which, or at whose end, a jump between two times may fall [N].

        - `first`, `last`: the earliest and the latest time of the jump [s].
        """
        spare = 1e-6 * self.period
        return (np.asarray(last) >= self.t - spare) & (np.asarray(first) <= self.t + self.period + spare)


def largest(lower: Any, upper: Any) -> Floats:
    """The largest size of any number between two.

    - `lower`, `upper`: the ends.
    """
    return np.asarray(np.maximum(np.abs(np.asarray(lower, float)), np.abs(np.asarray(upper, float))))


class AbstractDisturbance(AbstractPart):
    """A generalised force `τ_d(t, q, q̇)` on the joints, eq. (10). `a + b` adds two, `2.0 * a` scales one."""

    @abstractmethod
    def __call__(self, t: Scalar, state: State) -> Vector:
        """`τ_d`, [n], N m or N.

        - `t`: time [s].
        - `state`: positions and velocities.
        """

    def breakpoints(self) -> tuple[float, ...]:
        """Times at which the force sets in, jumps or ends [s]; each short pulse contains one of them."""
        return ()

    def off_chord(self, upper: Any, samples: Samples) -> Floats:
        """Bound of the force's distance from the straight line between its values at two samples [N n], N m or N.

        The bound holds for every disturbance of this class with parameters between those of `self` and `upper`. A class
        without its own bound has an infinite one, and no certificate covers it.

        - `upper`: has the largest value of each parameter, as `self` has the smallest.
        - `samples`: a period apart.
        """
        return np.full(samples.q.shape, np.inf)

    def __add__(self, other: AbstractDisturbance) -> Sum:
        return Sum((self, other))

    def __mul__(self, factor: Any) -> Scaled:
        return Scaled(self, factor)

    __rmul__ = __mul__


MOST_TERMS = 50
"""Largest number of terms in a sum: each term is compiled separately."""


class Sum(AbstractDisturbance):
    """Several disturbances at once."""

    terms: tuple[AbstractDisturbance, ...] = piece("what adds up")

    def __check_init__(self) -> None:
        if len(self.terms) > MOST_TERMS:
            raise DefinitionError(f"`Sum.terms` must be at most {MOST_TERMS}; got {len(self.terms)}")

    def __call__(self, t: Scalar, state: State) -> Vector:
        """The sum of all terms, [n], N m or N; zero if there is none."""
        return sum((term(t, state) for term in self.terms), start=0.0 * state.q)

    def breakpoints(self) -> tuple[float, ...]:
        """Breakpoints of all terms [s]."""
        return tuple(time for term in self.terms for time in term.breakpoints())

    def off_chord(self, upper: Any, samples: Samples) -> Floats:
        """The sum of the terms' bounds."""
        pairs = zip(self.terms, upper.terms, strict=True)
        return sum((low.off_chord(high, samples) for low, high in pairs), start=np.zeros(samples.q.shape))


class Scaled(AbstractDisturbance):
    """A disturbance times a factor; 0 switches it off, without a new compilation."""

    disturbance: AbstractDisturbance = piece("what is scaled")
    factor: Scalar = parameter("what it is multiplied by")

    def __call__(self, t: Scalar, state: State) -> Vector:
        """The scaled force, [n], N m or N."""
        return self.factor * self.disturbance(t, state)

    def breakpoints(self) -> tuple[float, ...]:
        """Breakpoints of the scaled disturbance [s]."""
        return self.disturbance.breakpoints()

    def off_chord(self, upper: Any, samples: Samples) -> Floats:
        """The factor's largest size times the bound of the scaled disturbance."""
        factor = largest(self.factor, upper.factor)
        if not factor.any():
            return np.zeros(samples.q.shape)
        return factor * self.disturbance.off_chord(upper.disturbance, samples)
