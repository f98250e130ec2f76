"""The paper's power function with a smooth core."""

from __future__ import annotations

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from .power import power


def smooth_power_and_slope(
    x: Float[Array, "..."], p: Float[Array, "..."], delta: Float[Array, "..."]
) -> tuple[Float[Array, "..."], Float[Array, "..."]]:
    """`s^p(x)`, eq. (29), and its slope, eq. (33), by one power.

    `s^p(x) = sig^p(x)` for `|x| >= delta`, else `l1 x + l2 sig²(x) + l3 x³` with (30)-(32). Odd, increasing, and twice
    continuously differentiable at `|x| = delta` (the paper claims once, (74)-(77)).

    With `w = max(|x|, delta)^(p-1)`, `z = min(|x|/delta, 1)` and `c_i = l_i delta^(i-p)`, both branches are
    `x w (c1 + c2 z + c3 z²)`, since `c1 + c2 + c3 = 1`; and both slopes are `w (c1 + 2 c2 z + 3 c3 z²)`.

    - `x`: any real array.
    - `p`: exponent in (0, 1), broadcast with `x`.
    - `delta`: half-width of the core, in (0, 1], broadcast with `x`.
    """
    magnitude = jnp.abs(x)
    exponent = p - 1.0
    edge = power(delta, exponent)
    # Near the goal all entries are in the core, and a power is the most expensive operation of a control step.
    far = magnitude >= delta
    w = jax.lax.cond(
        jnp.any(far),
        lambda: power(jnp.where(far, magnitude, delta), exponent),
        lambda: jnp.broadcast_to(edge, jnp.broadcast_shapes(magnitude.shape, edge.shape)),
    )
    # Not by `minimum` and `maximum`: where both sides are alike, at |x| = delta, each would halve its derivative.
    z = jnp.where(far, 1.0, magnitude * (1.0 / delta))
    c1 = 0.5 * p * p - 2.5 * p + 3.0
    c2 = -p * p + 4.0 * p - 3.0
    c3 = 0.5 * p * p - 1.5 * p + 1.0
    return x * w * (c1 + z * (c2 + z * c3)), w * (c1 + z * (2.0 * c2 + z * 3.0 * c3))


def smooth_power(x: Float[Array, "..."], p: Float[Array, "..."], delta: Float[Array, "..."]) -> Float[Array, "..."]:
    """`s^p(x)`, eq. (29).

    - `x`: any real array.
    - `p`: exponent in (0, 1), broadcast with `x`.
    - `delta`: half-width of the core, in (0, 1], broadcast with `x`.
    """
    return smooth_power_and_slope(x, p, delta)[0]
