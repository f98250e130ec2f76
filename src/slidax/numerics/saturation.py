"""The saturation function."""

from __future__ import annotations

import jax.numpy as jnp
from jaxtyping import Array, Float


def saturation(x: Float[Array, "..."], width: Float[Array, "..."]) -> Float[Array, "..."]:
    """`sat(x/width)`: `x/width` for `|x| <= width`, else `sgn(x)`, elementwise; for `width = 0` it is `sgn(x)`.

    - `x`: any real array.
    - `width`: half-width of the linear range, >= 0, broadcast with `x`.
    """
    wide = width > 0
    straight = jnp.clip(x / jnp.where(wide, width, 1.0), -1.0, 1.0)
    return jnp.where(wide, straight, jnp.sign(x))
