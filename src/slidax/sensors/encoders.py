"""Encoders for the positions, and velocities that are measured too."""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Int

from slidax._errors import as_array, known, require, require_consistent, require_shape
from slidax._types import PerJoint, Scalar, State

from .chance import ENCODERS, normal, whole
from .rounding import rounded
from .sensor import AbstractSensor, Measurement


class Encoders(AbstractSensor):
    """`q' = r round((q + σ_q ν)/r)`, `q̇' = q̇ + σ_v ν'`, where ν and ν' are white with mean 0 and deviation 1.

    The velocity has a sensor of its own, as with a tachometer; drives that difference their encoder are
    `DifferencedEncoders`.

    - `resolution`: r, one number or [n], rad or m, >= 0; 0 rounds nothing. 2π over the counts per turn.
    - `position_noise`: σ_q, before rounding, one number or [n], rad or m, >= 0.
    - `velocity_noise`: σ_v, one number or [n], rad/s or m/s, >= 0.
    - `seed`: a whole number; another seed gives other noise.

    Raises DefinitionError if one of them is out of its range.
    """

    resolution: PerJoint = eqx.field(converter=as_array)
    position_noise: PerJoint = eqx.field(converter=as_array, default=0.0)
    velocity_noise: PerJoint = eqx.field(converter=as_array, default=0.0)
    seed: Int[Array, ""] = eqx.field(converter=whole, default=0)

    def __check_init__(self) -> None:
        require_consistent(self, "resolution", "position_noise", "velocity_noise")
        require_shape(self, (), "seed")
        for field in ("resolution", "position_noise", "velocity_noise"):
            require(self, field, known(getattr(self, field)) >= 0, "must be >= 0 (0 for none)")

    def init(self, state: State) -> tuple[()]:
        """Nothing to keep.

        - `state`: true positions and velocities at sample 0.
        """
        return ()

    def __call__(
        self, k: Int[Array, ""], state: State, period: Scalar, memory: tuple[()]
    ) -> tuple[Measurement, tuple[()]]:
        """Rounded positions and noisy velocities.

        - `k`: number of the sample.
        - `state`: true positions and velocities at it.
        - `period`: time between two samples [s].
        - `memory`: empty.
        """
        noise = normal(self.seed, ENCODERS, k, (2, *state.q.shape))
        measured = State(
            q=rounded(state.q + self.position_noise * noise[0], self.resolution),
            dq=state.dq + self.velocity_noise * noise[1],
        )
        return Measurement(state=measured, fresh=jnp.asarray(True)), ()
