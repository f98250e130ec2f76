"""A force with a beginning and an end, such as a payload's weight."""

from __future__ import annotations

from typing import Any

import jax.numpy as jnp
import numpy as np

from slidax.parts import Scalar, State, Vector, parameter

from .disturbance import AbstractDisturbance, Floats, Samples, largest


class Step(AbstractDisturbance):
    """`τ_d = c` for `start <= t < end`, else 0."""

    title = "A force with a beginning and an end, such as a payload's weight."

    value: Vector = parameter("c, the force", "N m or N")
    start: Scalar = parameter("when it sets in", "s")
    end: Scalar = parameter("when it ends; infinite if it stays", "s", "(start, inf]", default=float("inf"))

    def __call__(self, t: Scalar, state: State) -> Vector:
        """`c` while it lasts, [n], N m or N."""
        return jnp.where((t >= self.start) & (t < self.end), self.value, 0.0)

    def breakpoints(self) -> tuple[float, ...]:
        """Beginning and end of the force [s]."""
        return tuple(time for time in (float(self.start), float(self.end)) if np.isfinite(time))

    def off_chord(self, upper: Any, samples: Samples) -> Floats:
        """|c| in each period with a possible jump inside or at its end; else zero."""
        jumps = samples.jumps(self.start, upper.start) | samples.jumps(self.end, upper.end)
        return jumps[:, None] * largest(self.value, upper.value)
