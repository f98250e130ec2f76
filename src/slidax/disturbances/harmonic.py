"""A sinusoidal force."""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp

from slidax._errors import as_array, require, require_consistent
from slidax._types import PerJoint, Scalar, State, Vector

from .disturbance import AbstractDisturbance


class Harmonic(AbstractDisturbance):
    """`τ_d = a sin(ω t + φ)`, per joint. Both examples of the paper are sums of these and a constant.

    - `amplitude`: a, [n], N m or N.
    - `frequency`: ω, [n] or one number, rad/s.
    - `phase`: φ, [n] or one number, rad.

    Raises DefinitionError if one of them is not finite.
    """

    amplitude: Vector = eqx.field(converter=as_array)
    frequency: PerJoint = eqx.field(converter=as_array)
    phase: PerJoint = eqx.field(converter=as_array, default=0.0)

    def __check_init__(self) -> None:
        require_consistent(self, "amplitude", "frequency", "phase")
        for field in ("amplitude", "frequency", "phase"):
            require(self, field, True, "must be finite")

    def __call__(self, t: Scalar, state: State) -> Vector:
        """`a sin(ω t + φ)`, [n], N m or N.

        - `t`: time [s].
        - `state`: positions and velocities.
        """
        return self.amplitude * jnp.sin(self.frequency * t + self.phase)
