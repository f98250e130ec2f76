"""What a run whose joints lead a tool shows of that tool."""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from slidax._types import Scalar
from slidax.numerics import vector_norm


class Tool(eqx.Module):
    """How far the tip is from where the reference has it, over all samples; each [], m.

    - `error`: the most.
    - `steady`: the most in the last quarter of the run.
    - `square`: sum of its squares, m².
    """

    error: Scalar
    steady: Scalar
    square: Scalar

    @staticmethod
    def begin() -> Tool:
        """Before the first sample."""
        nothing = jnp.zeros(())
        return Tool(error=nothing, steady=nothing, square=nothing)

    def add(self, away: Float[Array, "3"], running: Bool[Array, ""], steady: Bool[Array, ""]) -> Tool:
        """The same with one more sample.

        - `away`: from where the tip should be to where it is [3], m.
        - `running`: whether the sample counts.
        - `steady`: whether it also counts as one of the last quarter.
        """
        size = vector_norm(away)
        return Tool(
            error=jnp.where(running, jnp.maximum(self.error, size), self.error),
            steady=jnp.where(steady, jnp.maximum(self.steady, size), self.steady),
            square=jnp.where(running, self.square + size * size, self.square),
        )
