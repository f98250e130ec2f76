"""What every disturbance is, and how two become one."""

from __future__ import annotations

from abc import abstractmethod
from typing import Any

from slidax.parts import AbstractPart, DefinitionError, Scalar, State, Vector, parameter, piece


class AbstractDisturbance(AbstractPart):
    """A generalised force `τ_d(t, q, q̇)` on the joints, eq. (10). `a + b` adds two, `2.0 * a` scales one."""

    @abstractmethod
    def __call__(self, t: Scalar, state: State) -> Vector:
        """`τ_d`, [n], N m or N.

        - `t`: time [s].
        - `state`: positions and velocities.
        """

    def __add__(self, other: AbstractDisturbance) -> Sum:
        return Sum((self, other))

    def __mul__(self, factor: Any) -> Scaled:
        return Scaled(self, factor)

    __rmul__ = __mul__


MOST_TERMS = 50
"""Of a sum: each is compiled by itself."""


class Sum(AbstractDisturbance):
    """Several disturbances at once."""

    terms: tuple[AbstractDisturbance, ...] = piece("what adds up")

    def __check_init__(self) -> None:
        if len(self.terms) > MOST_TERMS:
            raise DefinitionError(f"`Sum.terms` must be at most {MOST_TERMS}; got {len(self.terms)}")

    def __call__(self, t: Scalar, state: State) -> Vector:
        """The sum of all terms, [n], N m or N; zero if there is none.

        - `t`: time [s].
        - `state`: positions and velocities.
        """
        return sum((term(t, state) for term in self.terms), start=0.0 * state.q)


class Scaled(AbstractDisturbance):
    """A disturbance times a factor; 0 switches it off, without a new compilation."""

    disturbance: AbstractDisturbance = piece("what is scaled")
    factor: Scalar = parameter("what it is multiplied by")

    def __call__(self, t: Scalar, state: State) -> Vector:
        """The scaled force, [n], N m or N.

        - `t`: time [s].
        - `state`: positions and velocities.
        """
        return self.factor * self.disturbance(t, state)
