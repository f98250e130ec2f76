"""The identity, for schemes without an envelope."""

from __future__ import annotations

import jax.numpy as jnp

from slidax._types import Scalar, Vector

from .frame import Frame
from .transformation import AbstractTransformation, TransformedError


class Unconstrained(AbstractTransformation):
    """`ε1 = e`, `ε2 = ė`, `B = I`, `A = Ȧ = 0`: with it, (40)-(45) are the law of a scheme without an envelope."""

    title = "The identity, for schemes without an envelope."

    def init(self, t: Scalar, e: Vector) -> tuple[()]:
        return ()

    def __call__(self, t: Scalar, e: Vector, de: Vector, memory: tuple[()]) -> TransformedError:
        """The error and its rate as they are, [rad], [rad/s]."""
        zero = jnp.zeros_like(e)
        return TransformedError(eps1=e, eps2=de, beta=jnp.ones_like(e), alpha=zero, alpha_rate=zero)

    def envelope(self, t: Scalar, memory: tuple[()]) -> None:
        return None

    def frame(self, t: Scalar, lead: Scalar, horizon: Scalar, memory: tuple[()]) -> Frame:
        half_width = jnp.ones(())
        return Frame(now=half_width, ahead=half_width, sides=None)
