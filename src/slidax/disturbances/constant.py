"""A constant force."""

from __future__ import annotations

from typing import Any

import numpy as np

from slidax.parts import Scalar, State, Vector, parameter

from .disturbance import AbstractDisturbance, Floats, Samples


class Constant(AbstractDisturbance):
    """`τ_d = c`."""

    title = "A constant force."

    value: Vector = parameter("c, the force", "N m or N")

    def __call__(self, t: Scalar, state: State) -> Vector:
        """`c`, [n], N m or N."""
        return self.value

    def off_chord(self, upper: Any, samples: Samples) -> Floats:
        """Zero for a constant force."""
        return np.zeros(samples.q.shape)
