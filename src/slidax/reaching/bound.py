"""What every bound of the uncertainty is."""

from __future__ import annotations

from abc import abstractmethod

from slidax.parts import AbstractPart, Scalar, State, Vector


class AbstractBound(AbstractPart):
    """How large the robust torque must be, or the uncertainty can be: u of (45), from the state and `τ0 + τ1`."""

    @abstractmethod
    def __call__(self, state: State, tau: Vector) -> Scalar:
        """The bound, N m.

        - `state`: positions and velocities.
        - `tau`: `τ0 + τ1` [n], N m or N.
        """
