"""A sinusoid per joint."""

from __future__ import annotations

import jax.numpy as jnp

from slidax.parts import PerJoint, Scalar, Vector, parameter

from .trajectory import AbstractTrajectory


class Sinusoid(AbstractTrajectory):
    """`q_d(t) = c + a sin(ω t + φ)`, per joint. Example 4.2 follows one."""

    title = "A sinusoid per joint."

    offset: Vector = parameter("c, the middle", "rad or m")
    amplitude: PerJoint = parameter("a, amplitude", "rad or m")
    frequency: PerJoint = parameter("ω, angular frequency", "rad/s")
    phase: PerJoint = parameter("φ, phase at t = 0", "rad", default=0.0)

    def position(self, t: Scalar) -> Vector:
        return self.offset + self.amplitude * jnp.sin(self.frequency * t + self.phase)
