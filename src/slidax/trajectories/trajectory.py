"""Base class of all trajectories."""

from __future__ import annotations

import math
from abc import abstractmethod

from slidax._types import Reference
from slidax.numerics import value_rate_curvature
from slidax.parts import AbstractPart, Scalar, Vector


class AbstractTrajectory(AbstractPart):
    """A desired motion `q_d(t)`. Subclasses define the position; velocity and acceleration are its derivatives."""

    @property
    def until(self) -> Scalar | float:
        """Time after which the motion stands still [s]; infinite for an endless motion."""
        return math.inf

    @abstractmethod
    def position(self, t: Scalar) -> Vector:
        """Return `q_d(t)`, [n], rad or m, at time t [s]."""

    def reference(self, t: Scalar) -> Reference:
        """Return `q_d`, `q̇_d`, `q̈_d` at time t [s]."""
        q, dq, ddq = value_rate_curvature(self.position, t)
        return Reference(q=q, dq=dq, ddq=ddq)
