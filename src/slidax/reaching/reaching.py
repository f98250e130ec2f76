"""What every reaching law is."""

from __future__ import annotations

from abc import abstractmethod

import equinox as eqx

from slidax._types import Matrix, Scalar, Vector


class AbstractReaching(eqx.Module):
    """The torque that drives s to zero, `-power(s) - u direction(s)`: a known part, and a robust one of size u."""

    @abstractmethod
    def power(self, s: Vector) -> Vector:
        """The known part of the torque, [n], N m or N, along s; 0 at s = 0.

        - `s`: sliding variable [n], rad/s or m/s.
        """

    @abstractmethod
    def direction(self, s: Vector) -> Vector:
        """Where the robust part points, [n], no longer than 1, along s; 0 at s = 0.

        - `s`: sliding variable [n], rad/s or m/s.
        """

    @abstractmethod
    def implicit(self, metric: Matrix, s: Vector, u: Scalar) -> Vector:
        """The s⁺ with `A (s⁺ - s) = -power(s⁺) - u direction(s⁺)`, [n]: the law held over a period, to its end.

        - `metric`: A = M0/H, symmetric positive definite [n n].
        - `s`: sliding variable [n], rad/s or m/s.
        - `u`: size of the robust torque, >= 0, N m.
        """
