"""A force that sets in at a time, such as a payload's weight or a push."""

from __future__ import annotations

import jax.numpy as jnp

from slidax.parts import Scalar, State, Vector, parameter

from .disturbance import AbstractDisturbance


class Step(AbstractDisturbance):
    """`τ_d = c` for `start <= t < end`, else 0."""

    value: Vector = parameter("c, the force", "N m or N")
    start: Scalar = parameter("when it sets in", "s")
    end: Scalar = parameter("when it ends; infinite if it stays", "s", "(start, inf]", default=float("inf"))

    def __call__(self, t: Scalar, state: State) -> Vector:
        """`c` while it lasts, [n], N m or N.

        - `t`: time [s].
        - `state`: positions and velocities.
        """
        return jnp.where((t >= self.start) & (t < self.end), self.value, 0.0)
