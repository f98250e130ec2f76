"""Margin from a law's monitor."""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Int

from slidax._types import Scalar


class Promise(eqx.Module):
    """The monitor's margin over all samples.

    - `margin`: minimum, []; inf before the first sample.
    - `warned`: number of the first sample with a negative margin, []; -1 without one.
    """

    margin: Scalar
    warned: Int[Array, ""]

    @staticmethod
    def begin() -> Promise:
        """Before the first sample."""
        return Promise(margin=jnp.full((), jnp.inf), warned=jnp.full((), -1))

    def add(self, k: Int[Array, ""], margin: Scalar, running: Bool[Array, ""]) -> Promise:
        """Add the monitor's margin at sample k."""
        first = running & (margin < 0.0) & (self.warned < 0)
        return Promise(
            margin=jnp.where(running, jnp.minimum(self.margin, margin), self.margin),
            warned=jnp.where(first, k, self.warned),
        )
