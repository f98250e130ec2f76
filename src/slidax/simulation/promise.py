"""What a law's monitor said in a run."""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Int

from slidax._types import Scalar


class Promise(eqx.Module):
    """The monitor's margin over all samples.

    - `margin`: the least, []; inf before the first sample.
    - `warned`: number of the first sample at which it was negative, []; -1 if there is none.
    """

    margin: Scalar
    warned: Int[Array, ""]

    @staticmethod
    def begin() -> Promise:
        """Before the first sample."""
        return Promise(margin=jnp.full((), jnp.inf), warned=jnp.full((), -1))

    def add(self, k: Int[Array, ""], margin: Scalar, running: Bool[Array, ""]) -> Promise:
        """The same with one more sample.

        - `k`: number of the sample.
        - `margin`: that the monitor says.
        - `running`: whether the run is not over yet.
        """
        first = running & (margin < 0.0) & (self.warned < 0)
        return Promise(
            margin=jnp.where(running, jnp.minimum(self.margin, margin), self.margin),
            warned=jnp.where(first, k, self.warned),
        )
