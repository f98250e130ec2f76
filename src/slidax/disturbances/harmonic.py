"""A sinusoidal force."""

from __future__ import annotations

import jax.numpy as jnp

from slidax.parts import PerJoint, Scalar, State, Vector, parameter

from .disturbance import AbstractDisturbance


class Harmonic(AbstractDisturbance):
    """`τ_d = a sin(ω t + φ)`, per joint. Both examples of the paper are sums of these and a constant."""

    amplitude: Vector = parameter("a, amplitude", "N m or N")
    frequency: PerJoint = parameter("ω, angular frequency", "rad/s")
    phase: PerJoint = parameter("φ, phase at t = 0", "rad", default=0.0)

    def __call__(self, t: Scalar, state: State) -> Vector:
        """`a sin(ω t + φ)`, [n], N m or N.

        - `t`: time [s].
        - `state`: positions and velocities.
        """
        return self.amplitude * jnp.sin(self.frequency * t + self.phase)
