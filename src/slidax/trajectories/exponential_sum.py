"""A sum of decaying exponentials."""

from __future__ import annotations

import jax.numpy as jnp
from jaxtyping import Array, Float

from slidax.parts import DefinitionError, Scalar, Vector, parameter

from .trajectory import AbstractTrajectory

MOST_TERMS = 50
"""Of a sum: machine code computes them one by one."""


class ExponentialSum(AbstractTrajectory):
    """`q_d(t) = c + Σ_k a_k exp(-λ_k t)`: a smooth move that comes to rest at c. Example 4.1 follows one."""

    title = "A sum of decaying exponentials."

    offset: Vector = parameter("c, where it comes to rest", "rad or m")
    amplitudes: Float[Array, "k n"] = parameter("a_k, one row per term", "rad or m")
    rates: Float[Array, " k"] = parameter(
        "λ_k, how fast each term decays", "1/s", "> 0", "so that the motion comes to rest"
    )

    def __check_init__(self) -> None:
        if self.rates.size > MOST_TERMS:
            raise DefinitionError(f"`ExponentialSum.rates` must be at most {MOST_TERMS}; got {self.rates.size}")
        fits = self.amplitudes.ndim == 2 and self.amplitudes.shape == (*self.rates.shape, *self.offset.shape)
        if not fits:
            raise DefinitionError(
                "`ExponentialSum.amplitudes` must have one row per rate and one column per joint; "
                f"got shape {list(self.amplitudes.shape)}"
            )

    def position(self, t: Scalar) -> Vector:
        return self.offset + jnp.sum(self.amplitudes * jnp.exp(-self.rates * t)[:, None], axis=0)
