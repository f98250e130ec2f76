"""A sum of decaying exponentials."""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from slidax._errors import as_array, known, require
from slidax._types import Scalar, Vector

from .trajectory import AbstractTrajectory


class ExponentialSum(AbstractTrajectory):
    """`q_d(t) = c + Σ_k a_k exp(-λ_k t)`: a smooth move that comes to rest at c. Example 4.1 follows one.

    - `offset`: c, [n], rad or m.
    - `amplitudes`: a_k, one row per term, [k n], rad or m.
    - `rates`: λ_k, [k], 1/s, positive.

    Raises DefinitionError if a rate is not positive or there are not as many rates as rows.
    """

    offset: Vector = eqx.field(converter=as_array)
    amplitudes: Float[Array, "k n"] = eqx.field(converter=as_array)
    rates: Float[Array, " k"] = eqx.field(converter=as_array)

    def __check_init__(self) -> None:
        require(self, "offset", True, "must be finite")
        require(self, "rates", known(self.rates) > 0, "must be > 0, so that the motion comes to rest")
        fits = self.amplitudes.ndim == 2 and self.amplitudes.shape == (*self.rates.shape, *self.offset.shape)
        require(self, "amplitudes", fits, "must have one row per rate and one column per joint")

    def position(self, t: Scalar) -> Vector:
        """`c + Σ_k a_k exp(-λ_k t)`.

        - `t`: time [s].
        """
        return self.offset + jnp.sum(self.amplitudes * jnp.exp(-self.rates * t)[:, None], axis=0)
