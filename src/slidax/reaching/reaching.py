"""Base class of the reaching laws."""

from __future__ import annotations

from abc import abstractmethod

from slidax.parts import AbstractPart, Matrix, Scalar, Vector


class AbstractReaching(AbstractPart):
    """The torque that drives s to zero: a continuous term of known size, and a switching one of size u."""

    @abstractmethod
    def continuous_term(self, s: Vector) -> Vector:
        """The continuous part of that torque, against the signs of s, [n], N m or N; 0 at s = 0.

        - `s`: sliding variable [n], rad/s or m/s.
        """

    @abstractmethod
    def switching_direction(self, s: Vector) -> Vector:
        """Negative direction of the switching part, [n], along s, no longer than 1; 0 at s = 0.

        - `s`: sliding variable [n], rad/s or m/s.
        """

    @abstractmethod
    def implicit(self, metric: Matrix, s: Vector, u: Scalar) -> Vector:
        """The s⁺ with `A (s⁺ - s) = -P(s⁺) - u N(s⁺)`, P and N the two terms, [n]: the law held to the end of a step.

        - `metric`: A = M0/H, symmetric positive definite [n n].
        - `s`: sliding variable [n], rad/s or m/s.
        - `u`: size of the robust torque, >= 0, N m.
        """
