"""The unit vector, discontinuous or smoothed."""

from __future__ import annotations

import jax.numpy as jnp

from slidax._types import Scalar, Vector

from .vector_norm import vector_norm


def unit_vector(x: Vector, layer: Scalar) -> Vector:
    """`x/(‖x‖ + layer)`, [n], and 0 at x = 0.

    - `x`: vector [n].
    - `layer`: >= 0, in the unit of `x`; 0 gives the unit vector.
    """
    size = vector_norm(x) + layer
    return x / jnp.where(size > 0, size, 1.0)
