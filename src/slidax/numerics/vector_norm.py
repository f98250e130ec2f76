"""The 2-norm with a finite gradient at zero."""

from __future__ import annotations

import jax
import jax.numpy as jnp

from slidax._types import Scalar, Vector


@jax.custom_jvp
def vector_norm(x: Vector) -> Scalar:
    """`‖x‖ = √(xᵀx)`; its gradient at x = 0 is taken as 0.

    - `x`: vector [n].
    """
    return jnp.sqrt(jnp.sum(x * x))


@vector_norm.defjvp
def _vector_norm_jvp(primals: tuple[Vector], tangents: tuple[Vector]) -> tuple[Scalar, Scalar]:
    (x,), (dx,) = primals, tangents
    norm = vector_norm(x)
    return norm, jnp.where(norm > 0, jnp.sum(x * dx) / jnp.where(norm > 0, norm, 1.0), 0.0)
