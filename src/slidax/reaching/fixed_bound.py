"""A robust torque of constant size."""

from __future__ import annotations

from slidax.parts import Scalar, State, Vector, parameter

from .bound import AbstractBound


class FixedBound(AbstractBound):
    """`u = const`: for laws that choose the size of their robust torque by hand."""

    title = "A robust torque of constant size."

    size: Scalar = parameter("u, size of the robust torque", "N m", ">= 0")

    def __call__(self, state: State, tau: Vector) -> Scalar:
        return self.size
