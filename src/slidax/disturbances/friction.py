"""Friction in the joints."""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp

from slidax._errors import as_array, known, require, require_consistent
from slidax._types import PerJoint, Scalar, State, Vector

from .disturbance import AbstractDisturbance


class Friction(AbstractDisturbance):
    """`τ_d = -(f_c tanh(q̇/v_s) + f_v q̇)`: Coulomb friction, smoothed near rest, and viscous friction.

    - `coulomb`: f_c, [n] or one number, N m or N, >= 0.
    - `viscous`: f_v, [n] or one number, N m s/rad or N s/m, >= 0.
    - `smoothing`: v_s, the velocity within which the sign turns, [n] or one number, rad/s or m/s, > 0.

    Raises DefinitionError if one of them is out of its range.
    """

    coulomb: PerJoint = eqx.field(converter=as_array)
    viscous: PerJoint = eqx.field(converter=as_array, default=0.0)
    smoothing: PerJoint = eqx.field(converter=as_array, default=0.01)

    def __check_init__(self) -> None:
        require_consistent(self, "coulomb", "viscous", "smoothing")
        require(self, "coulomb", known(self.coulomb) >= 0, "must be >= 0, or it would drive the joint")
        require(self, "viscous", known(self.viscous) >= 0, "must be >= 0, or it would drive the joint")
        require(self, "smoothing", known(self.smoothing) > 0, "must be > 0")

    def __call__(self, t: Scalar, state: State) -> Vector:
        """The friction force, [n], N m or N.

        - `t`: time [s].
        - `state`: positions and velocities.
        """
        return -(self.coulomb * jnp.tanh(state.dq / self.smoothing) + self.viscous * state.dq)
