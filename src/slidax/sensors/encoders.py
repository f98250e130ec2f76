"""Position encoders with velocity sensors."""

from __future__ import annotations

import jax.numpy as jnp
from jaxtyping import Array, Int

from slidax.parts import PerJoint, Scalar, State, parameter

from .chance import ENCODERS, normal, seed
from .rounding import rounded
from .sensor import AbstractSensor, Measurement


class Encoders(AbstractSensor):
    """`q' = r round((q + σ_q ν)/r)`, `q̇' = q̇ + σ_v ν'`, where ν and ν' are white with mean 0 and deviation 1.

    The velocity has its own sensor, such as a tachometer. For drives that difference their encoder, use
    `DifferencedEncoders`.
    """

    title = "Position encoders with velocity sensors."

    resolution: PerJoint = parameter("r, 2π over the counts per turn", "rad or m", ">= 0", "(0 for none)")
    position_noise: PerJoint = parameter(
        "σ_q, standard deviation before rounding", "rad or m", ">= 0", "(0 for none)", default=0.0
    )
    velocity_noise: PerJoint = parameter("σ_v, standard deviation", "rad/s or m/s", ">= 0", "(0 for none)", default=0.0)
    seed: Int[Array, ""] = seed("noise")

    def init(self, state: State) -> tuple[()]:
        return ()

    def __call__(
        self, k: Int[Array, ""], state: State, period: Scalar, memory: tuple[()]
    ) -> tuple[Measurement, tuple[()]]:
        """Rounded positions and noisy velocities."""
        noise = normal(self.seed, ENCODERS, k, (2, *state.q.shape))
        measured = State(
            q=rounded(state.q + self.position_noise * noise[0], self.resolution),
            dq=state.dq + self.velocity_noise * noise[1],
        )
        return Measurement(state=measured, fresh=jnp.asarray(True)), ()
