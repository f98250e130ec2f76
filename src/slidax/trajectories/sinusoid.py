"""A sinusoid per joint."""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp

from slidax._errors import as_array, require, require_consistent
from slidax._types import PerJoint, Scalar, Vector

from .trajectory import AbstractTrajectory


class Sinusoid(AbstractTrajectory):
    """`q_d(t) = c + a sin(ω t + φ)`, per joint. Example 4.2 follows one.

    - `offset`: c, [n], rad or m.
    - `amplitude`: a, [n] or one number, rad or m.
    - `frequency`: ω, [n] or one number, rad/s.
    - `phase`: φ, [n] or one number, rad.

    Raises DefinitionError if one of them is not finite or does not fit the offset.
    """

    offset: Vector = eqx.field(converter=as_array)
    amplitude: PerJoint = eqx.field(converter=as_array)
    frequency: PerJoint = eqx.field(converter=as_array)
    phase: PerJoint = eqx.field(converter=as_array, default=0.0)

    def __check_init__(self) -> None:
        require_consistent(self, "offset", "amplitude", "frequency", "phase")
        for field in ("offset", "amplitude", "frequency", "phase"):
            require(self, field, True, "must be finite")

    def position(self, t: Scalar) -> Vector:
        """`c + a sin(ω t + φ)`.

        - `t`: time [s].
        """
        return self.offset + self.amplitude * jnp.sin(self.frequency * t + self.phase)
