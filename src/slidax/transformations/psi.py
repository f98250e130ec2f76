"""The logarithmic map between an envelope and the whole line."""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from slidax._types import Vector


class Sides(eqx.Module):
    """The two sides of the envelope as fractions of ρ, `lower ρ < e < upper ρ`, eq. (13).

    - `lower`: b, [n], in [-1, 0).
    - `upper`: b̄, [n], in (0, 1].
    """

    lower: Vector
    upper: Vector


def psi(x: Float[Array, "..."], sides: Sides) -> Float[Array, "..."]:
    """`ψ(x) = b b̄ (eˣ - 1)/(b eˣ - b̄)`, eq. (21): increasing, from b at -∞ to b̄ at +∞, and 0 at 0.

    - `x`: transformed error.
    - `sides`: b and b̄, broadcast with `x`.
    """
    return psi_and_slope(x, sides)[0]


def psi_and_slope(x: Float[Array, "..."], sides: Sides) -> tuple[Float[Array, "..."], Float[Array, "..."]]:
    """`ψ(x)` of (21), and `ψ'(x) = b b̄ (b - b̄) eˣ/(b eˣ - b̄)²`, which is > 0.

    - `x`: transformed error.
    - `sides`: b and b̄, broadcast with `x`.
    """
    b, b_bar = sides.lower, sides.upper
    # Each branch keeps the exponential below one, so that no argument overflows.
    small = -jnp.expm1(-jnp.abs(x))
    z = 1.0 - small
    above = x >= 0
    inverse = 1.0 / jnp.where(above, b - b_bar * z, b * z - b_bar)
    share = b * b_bar * inverse
    return jnp.where(above, share, -share) * small, share * inverse * (b - b_bar) * z


def psi_inverse(x: Float[Array, "..."], sides: Sides) -> Float[Array, "..."]:
    """`ψ⁻¹(x) = ln( b̄ (x - b) / (-b (b̄ - x)) )`, eq. (23); NaN outside (b, b̄).

    - `x`: error over radius, e/ρ.
    - `sides`: b and b̄, broadcast with `x`.
    """
    b, b_bar = sides.lower, sides.upper
    return jnp.log(b_bar * (x - b) / (-b * (b_bar - x)))


def psi_inverse_slope(x: Float[Array, "..."], sides: Sides) -> Float[Array, "..."]:
    """`v(x) = 1/(x - b) + 1/(b̄ - x)`, eq. (27), over a common denominator.

    - `x`: error over radius, e/ρ.
    - `sides`: b and b̄, broadcast with `x`.
    """
    return (sides.upper - sides.lower) / ((x - sides.lower) * (sides.upper - x))
