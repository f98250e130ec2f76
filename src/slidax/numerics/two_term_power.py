"""A power function with a core of a linear term and a higher power."""

from __future__ import annotations

import jax.numpy as jnp
from jaxtyping import Array, Float

from .power import power


def two_term_power_and_slope(
    x: Float[Array, "..."], a: Float[Array, "..."], r: Float[Array, "..."], delta: Float[Array, "..."]
) -> tuple[Float[Array, "..."], Float[Array, "..."]]:
    """`S_a(x)` and its slope by two powers.

    `S_a(x) = sig^a(x)` for `|x| >= delta`, else `l1 x + l2 sig^r(x)` with `l1 = (r-a)/(r-1) delta^(a-1)` and
    `l2 = (a-1)/(r-1) delta^(a-r)`. Odd, increasing, and continuously differentiable at `|x| = delta`.

    With `w = max(|x|, delta)^(a-1)`, `z = min(|x|/delta, 1)^(r-1)` and `c_1 = (r-a)/(r-1)`, `c_2 = 1 - c_1`, both
    branches are `x w (c1 + c2 z)`, and both slopes are `w (c1 + r c2 z)`.

    - `x`: any real array.
    - `a`: exponent in (0, 1), broadcast with `x`.
    - `r`: exponent of the core, > 1, broadcast with `x`.
    - `delta`: half-width of the core, > 0, broadcast with `x`.
    """
    magnitude = jnp.abs(x)
    inside = magnitude < delta
    w = power(jnp.where(inside, delta, magnitude), a - 1.0)
    z = power(jnp.where(inside, magnitude / delta, 1.0), r - 1.0)
    c1 = (r - a) / (r - 1.0)
    c2 = (a - 1.0) / (r - 1.0)
    return x * w * (c1 + c2 * z), w * (c1 + r * c2 * z)
