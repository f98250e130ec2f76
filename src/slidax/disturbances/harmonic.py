"""A sinusoidal force."""

from __future__ import annotations

from typing import Any

import jax.numpy as jnp
import numpy as np

from slidax.parts import PerJoint, Scalar, State, Vector, parameter

from .disturbance import AbstractDisturbance, Floats, Samples, largest


class Harmonic(AbstractDisturbance):
    """`τ_d = a sin(ω t + φ)`, per joint. Both examples of the paper are sums of these and a constant."""

    title = "A sinusoidal force."

    amplitude: Vector = parameter("a, amplitude", "N m or N")
    frequency: PerJoint = parameter("ω, angular frequency", "rad/s")
    phase: PerJoint = parameter("φ, phase at t = 0", "rad", default=0.0)

    def __call__(self, t: Scalar, state: State) -> Vector:
        """`a sin(ω t + φ)`, [n], N m or N."""
        return self.amplitude * jnp.sin(self.frequency * t + self.phase)

    def off_chord(self, upper: Any, samples: Samples) -> Floats:
        """`|a| min(ω² h²/8, 2)`: `h²/8` times its largest second derivative, and never more than from peak to peak."""
        angle = largest(self.frequency, upper.frequency) * samples.period
        bound: Floats = largest(self.amplitude, upper.amplitude) * np.minimum(angle**2 / 8.0, 2.0)
        return np.broadcast_to(bound, samples.q.shape)
