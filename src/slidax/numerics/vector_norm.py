"""The 2-norm with a finite gradient at zero."""

from __future__ import annotations

import jax.numpy as jnp

from slidax._types import Scalar, Vector


def vector_norm(x: Vector) -> Scalar:
    """`‖x‖ = √(xᵀx)`; its gradient at x = 0 is taken as 0.

    - `x`: vector [n].
    """
    square = jnp.sum(x * x)
    away = square > 0
    return jnp.where(away, jnp.sqrt(jnp.where(away, square, 1.0)), 0.0)
