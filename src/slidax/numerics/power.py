"""Powers whose derivatives cost no second power, and stay finite at zero."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
from jax.custom_derivatives import SymbolicZero
from jaxtyping import Array, Float


@jax.custom_jvp
def power(x: Float[Array, "..."], a: Float[Array, "..."]) -> Float[Array, "..."]:
    """`x^a` for `x >= 0`.

    Its derivative is taken as `a x^a / x`, and as 0 at `x = 0` (true for a > 1). A function and its time derivatives
    then share a single power, by far the most expensive operation of a step, and no infinity occurs at 0.

    - `x`: base, not negative.
    - `a`: exponent, broadcast with `x`.
    """
    return jnp.power(x, a)


def _power_jvp(primals: tuple[Any, Any], tangents: tuple[Any, Any]) -> tuple[Any, Any]:
    x, a = primals
    dx, da = tangents
    y = power(x, a)
    base = jnp.where(x > 0, x, 1.0)
    dy = jnp.zeros_like(y)
    if not isinstance(dx, SymbolicZero):
        dy = dy + jnp.where(x > 0, a * y / base, 0.0) * dx
    if not isinstance(da, SymbolicZero):
        dy = dy + y * jnp.log(base) * da
    return y, dy


power.defjvp(_power_jvp, symbolic_zeros=True)


def sig_and_slope(x: Float[Array, "..."], a: Float[Array, "..."]) -> tuple[Float[Array, "..."], Float[Array, "..."]]:
    """`sig^a(x)` and its slope `a |x|^(a-1)`, eqs. (34), (35), by one power.

    - `x`: any real array.
    - `a`: exponent > 1, broadcast with `x`.
    """
    w = power(jnp.abs(x), a - 1.0)
    return x * w, a * w


def sig(x: Float[Array, "..."], a: Float[Array, "..."]) -> Float[Array, "..."]:
    """`sig^a(x) = |x|^a sgn(x)`, elementwise, eqs. (1), (2); its derivative at 0 is taken as 0 (true for a > 1).

    - `x`: any real array.
    - `a`: exponent > 0, broadcast with `x`.
    """
    return jnp.sign(x) * power(jnp.abs(x), a)
