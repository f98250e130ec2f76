"""A fixed posture."""

from __future__ import annotations

import jax.numpy as jnp

from slidax.parts import Scalar, Vector, parameter

from .trajectory import AbstractTrajectory


class Constant(AbstractTrajectory):
    """`q_d(t) = c`."""

    kind = "constant"
    title = "A fixed posture."

    value: Vector = parameter("c, the posture", "rad or m")

    @property
    def until(self) -> float:
        return 0.0

    def position(self, t: Scalar) -> Vector:
        return self.value + 0.0 * t * jnp.zeros_like(self.value)
