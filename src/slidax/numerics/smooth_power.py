"""The paper's power function with a smooth core."""

from __future__ import annotations

import jax.numpy as jnp
from jaxtyping import Array, Float

from .power import power


def _parts(
    x: Float[Array, "..."], p: Float[Array, "..."], delta: Float[Array, "..."]
) -> tuple[Float[Array, "..."], Float[Array, "..."], tuple[Float[Array, "..."], ...]]:
    """`max(|x|, delta)^(p-1)`, `z = min(|x|/delta, 1)`, and the coefficients (30)-(32) without their powers of delta.

    With these, both branches of (29) are `x w (c1 + c2 z + c3 z²)`, since `c1 + c2 + c3 = 1`: one power serves all.
    """
    magnitude = jnp.abs(x)
    w = power(jnp.maximum(magnitude, delta), p - 1.0)
    z = jnp.minimum(magnitude / delta, 1.0)
    c1 = 0.5 * p * p - 2.5 * p + 3.0
    c2 = -p * p + 4.0 * p - 3.0
    c3 = 0.5 * p * p - 1.5 * p + 1.0
    return w, z, (c1, c2, c3)


def smooth_power(
    x: Float[Array, "..."], p: Float[Array, "..."], delta: Float[Array, "..."]
) -> Float[Array, "..."]:
    """`s^p(x)`, eq. (29): `sig^p(x)` for `|x| >= delta`, else `l1 x + l2 sig²(x) + l3 x³` with (30)-(32).

    Odd, increasing, twice continuously differentiable at `|x| = delta` (the paper claims once, (74)-(77)).

    - `x`: any real array.
    - `p`: exponent in (0, 1).
    - `delta`: half-width of the core, in (0, 1].
    """
    w, z, (c1, c2, c3) = _parts(x, p, delta)
    return x * w * (c1 + z * (c2 + z * c3))


def smooth_power_slope(
    x: Float[Array, "..."], p: Float[Array, "..."], delta: Float[Array, "..."]
) -> Float[Array, "..."]:
    """The slope of `s^p`, eq. (33): `p |x|^(p-1)` for `|x| >= delta`, else `l1 + 2 l2 |x| + 3 l3 x²`.

    - `x`: any real array.
    - `p`: exponent in (0, 1).
    - `delta`: half-width of the core, in (0, 1].
    """
    w, z, (c1, c2, c3) = _parts(x, p, delta)
    return w * (c1 + z * (2.0 * c2 + z * 3.0 * c3))
