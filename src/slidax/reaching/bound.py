"""Base class for the size of the robust torque."""

from __future__ import annotations

from abc import abstractmethod

from slidax.parts import AbstractPart, Scalar, State, Vector


class AbstractBound(AbstractPart):
    """`u`, the size of the robust torque, eqs. (44), (45): at least the bound of the uncertainty."""

    @abstractmethod
    def __call__(self, state: State, tau: Vector) -> Scalar:
        """`u`, N m.

        - `state`: positions and velocities.
        - `tau`: the torque without its robust part, `τ0 + τ1`, [n], N m or N.
        """
