"""Friction in the joints."""

from __future__ import annotations

import jax.numpy as jnp

from slidax.parts import PerJoint, Scalar, State, Vector, parameter

from .disturbance import AbstractDisturbance


class Friction(AbstractDisturbance):
    """`τ_d = -(f_c tanh(q̇/v_s) + f_v q̇)`: Coulomb friction, smoothed near rest, and viscous friction."""

    coulomb: PerJoint = parameter("f_c, Coulomb friction", "N m or N", ">= 0", "or it would drive the joint")
    viscous: PerJoint = parameter(
        "f_v, viscous friction", "N m s/rad or N s/m", ">= 0", "or it would drive the joint", default=0.0
    )
    smoothing: PerJoint = parameter(
        "v_s, the velocity within which the sign turns", "rad/s or m/s", "> 0", default=0.01
    )

    def __call__(self, t: Scalar, state: State) -> Vector:
        """The friction force, [n], N m or N.

        - `t`: time [s].
        - `state`: positions and velocities.
        """
        return -(self.coulomb * jnp.tanh(state.dq / self.smoothing) + self.viscous * state.dq)
