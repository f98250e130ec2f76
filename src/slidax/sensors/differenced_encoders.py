"""Encoders without velocity sensors: the velocity is a filtered difference of positions."""

from __future__ import annotations

import jax.numpy as jnp
from jaxtyping import Array, Int

from slidax.parts import PerJoint, Scalar, State, parameter

from .chance import DIFFERENCED_ENCODERS, normal, seed
from .rounding import rounded
from .sensor import AbstractSensor, Measurement


class DifferencedEncoders(AbstractSensor):
    """`q' = r round((q + σ ν)/r)`, and `v⁺ = v + (1 - e^{-c h}) ((q' - q'₋)/h - v)`, `q̇' = v⁺`.

    There is no velocity sensor: the velocity is the difference of the last two positions after a first-order low-pass,
    and lags by about `1/c + h/2`. At sample 0 it is the true velocity.
    """

    title = "Encoders without velocity sensors: the velocity is a filtered difference of positions."

    resolution: PerJoint = parameter("r, 2π over the counts per turn", "rad or m", ">= 0", "(0 for none)")
    position_noise: PerJoint = parameter(
        "σ, standard deviation before rounding", "rad or m", ">= 0", "(0 for none)", default=0.0
    )
    cutoff: PerJoint = parameter("c, of the low-pass", "rad/s", "> 0", default=600.0)
    seed: Int[Array, ""] = seed("noise")

    def init(self, state: State) -> State:
        """The position that was counted last, and the filtered velocity: at the start both are the true ones."""
        return state

    def __call__(self, k: Int[Array, ""], state: State, period: Scalar, memory: State) -> tuple[Measurement, State]:
        """Rounded positions, and the velocities that follow from them."""
        noise = normal(self.seed, DIFFERENCED_ENCODERS, k, state.q.shape)
        q = rounded(state.q + self.position_noise * noise, self.resolution)
        share = -jnp.expm1(-self.cutoff * period)
        moved = memory.dq + share * ((q - memory.q) / period - memory.dq)
        measured = State(q=q, dq=jnp.where(k > 0, moved, memory.dq))
        return Measurement(state=measured, fresh=jnp.asarray(True)), measured
