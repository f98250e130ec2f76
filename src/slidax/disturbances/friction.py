"""Coulomb and viscous friction in the joints."""

from __future__ import annotations

from typing import Any

import jax.numpy as jnp
import numpy as np

from slidax.parts import PerJoint, Scalar, State, Vector, parameter

from .disturbance import AbstractDisturbance, Floats, Samples, largest

BEND = 4.0 / (3.0 * 3.0**0.5)
"""The largest second derivative of tanh."""


class Friction(AbstractDisturbance):
    """`τ_d = -(f_c tanh(q̇/v_s) + f_v q̇)`: Coulomb friction, smoothed near rest, and viscous friction."""

    title = "Coulomb and viscous friction in the joints."

    coulomb: PerJoint = parameter("f_c, Coulomb friction", "N m or N", ">= 0", "or it would drive the joint")
    viscous: PerJoint = parameter(
        "f_v, viscous friction", "N m s/rad or N s/m", ">= 0", "or it would drive the joint", default=0.0
    )
    smoothing: PerJoint = parameter(
        "v_s, the velocity within which the sign turns", "rad/s or m/s", "> 0", default=0.01
    )

    def __call__(self, t: Scalar, state: State) -> Vector:
        """The friction force, [n], N m or N."""
        return -(self.coulomb * jnp.tanh(state.dq / self.smoothing) + self.viscous * state.dq)

    def off_chord(self, upper: Any, samples: Samples) -> Floats:
        """`f_c min(.77 x²/8, x, 2)`, `x = |Δq̇|/v_s`: by the curvature, slope or range of tanh.

        `max |tanh''| = 4/(3 √3)`. Viscous friction is as straight as the velocity.
        """
        x = samples.turn / np.asarray(self.smoothing)
        return largest(self.coulomb, upper.coulomb) * np.minimum(np.minimum(BEND * x * x / 8.0, x), 2.0)
