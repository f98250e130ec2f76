"""What every trajectory is."""

from __future__ import annotations

import math
from abc import abstractmethod

from slidax._types import Reference
from slidax.numerics import value_rate_curvature
from slidax.parts import AbstractPart, Scalar, Vector


class AbstractTrajectory(AbstractPart):
    """A desired motion `q_d(t)`. A member gives the position; velocity and acceleration follow by differentiation."""

    @property
    def until(self) -> Scalar | float:
        """The time from which on it stands still [s]; infinite for a motion without an end."""
        return math.inf

    @abstractmethod
    def position(self, t: Scalar) -> Vector:
        """`q_d(t)`, [n], rad or m.

        - `t`: time [s].
        """

    def reference(self, t: Scalar) -> Reference:
        """`q_d`, `q̇_d`, `q̈_d` at one time.

        - `t`: time [s].
        """
        q, dq, ddq = value_rate_curvature(self.position, t)
        return Reference(q=q, dq=dq, ddq=ddq)
