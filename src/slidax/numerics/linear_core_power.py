"""A power function with a linear core."""

from __future__ import annotations

import jax.numpy as jnp
from jaxtyping import Array, Float

from .power import power


def linear_core_power_and_slope(
    x: Float[Array, "..."], p: Float[Array, "..."], delta: Float[Array, "..."]
) -> tuple[Float[Array, "..."], Float[Array, "..."]]:
    """`ŝ^p(x)`, eq. (78), and its slope by one power.

    `ŝ^p(x) = sig^p(x)` for `|x| >= delta`, else `delta^(p-1) x`. Odd, increasing and continuous; its slope jumps at
    `|x| = delta` from `delta^(p-1)` inside to `p delta^(p-1)` outside, where the outer one is returned.

    With `w = max(|x|, delta)^(p-1)`, both branches are `x w`, and the slopes are `w` inside and `p w` outside.

    - `x`: any real array.
    - `p`: exponent in (0, 1), broadcast with `x`.
    - `delta`: half-width of the core, in (0, 1], broadcast with `x`.
    """
    magnitude = jnp.abs(x)
    inside = magnitude < delta
    w = power(jnp.where(inside, delta, magnitude), p - 1.0)
    return x * w, jnp.where(inside, w, p * w)
