"""Power functions, saturations and norms with finite derivatives at zero.

For exponents p below 1, the slope of `|x|^p sgn(x)` is infinite at 0. The power functions therefore replace it by
another function in a core, `|x| < delta`. Equation numbers are those of the paper, Nonlinear Dynamics (2022),
doi 10.1007/s11071-022-07650-w.
"""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
from jax.custom_derivatives import SymbolicZero
from jaxtyping import Array, Float

from .types import Scalar, Vector


@jax.custom_jvp
def power(x: Float[Array, "..."], a: Float[Array, "..."]) -> Float[Array, "..."]:
    """`x^a` for `x >= 0`.

    Its derivative is computed as `a x^a / x`, and as 0 at `x = 0` (true for a > 1), so that it is never infinite. A
    function and its time derivatives then share a single power, by far the most expensive operation of a control step.

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

    `sig^a(x) = |x|^a sgn(x)`, elementwise.

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


def smooth_power_and_slope(
    x: Float[Array, "..."], p: Float[Array, "..."], delta: Float[Array, "..."]
) -> tuple[Float[Array, "..."], Float[Array, "..."]]:
    """`s^p(x)`, eq. (29), and its slope, eq. (33), by one power.

    `s^p(x) = sig^p(x) = |x|^p sgn(x)` for `|x| >= delta`, else `l1 x + l2 sig²(x) + l3 x³` with the paper's (30)-(32).
    Odd, increasing, and twice continuously differentiable at `|x| = delta` (the paper claims once, (74)-(77)).

    With `w = max(|x|, delta)^(p-1)`, `z = min(|x|/delta, 1)` and `c_i = l_i delta^(i-p)`, both branches are
    `x w (c1 + c2 z + c3 z²)`, since `c1 + c2 + c3 = 1`; and both slopes are `w (c1 + 2 c2 z + 3 c3 z²)`.

    - `x`: any real array.
    - `p`: exponent in (0, 1), broadcast with `x`.
    - `delta`: half-width of the core, in (0, 1], broadcast with `x`.
    """
    magnitude = jnp.abs(x)
    exponent = p - 1.0
    edge = power(delta, exponent)
    # Near the goal all entries are in the core: skip the power, the most expensive operation of a control step.
    far = magnitude >= delta
    w = jax.lax.cond(
        jnp.any(far),
        lambda: power(jnp.where(far, magnitude, delta), exponent),
        lambda: jnp.broadcast_to(edge, jnp.broadcast_shapes(magnitude.shape, edge.shape)),
    )
    # Not by `minimum` and `maximum`: at |x| = delta, where their arguments are equal, each halves the derivative.
    z = jnp.where(far, 1.0, magnitude * (1.0 / delta))
    c1 = 0.5 * p * p - 2.5 * p + 3.0
    c2 = -p * p + 4.0 * p - 3.0
    c3 = 0.5 * p * p - 1.5 * p + 1.0
    return x * w * (c1 + z * (c2 + z * c3)), w * (c1 + z * (2.0 * c2 + z * 3.0 * c3))


def smooth_power(x: Float[Array, "..."], p: Float[Array, "..."], delta: Float[Array, "..."]) -> Float[Array, "..."]:
    """`s^p(x)`, eq. (29).

    The paper's smooth power: `|x|^p sgn(x)` for `|x| >= delta`, and a smooth cubic in the core.

    - `x`: any real array.
    - `p`: exponent in (0, 1), broadcast with `x`.
    - `delta`: half-width of the core, in (0, 1], broadcast with `x`.
    """
    return smooth_power_and_slope(x, p, delta)[0]


def linear_core_power_and_slope(
    x: Float[Array, "..."], p: Float[Array, "..."], delta: Float[Array, "..."]
) -> tuple[Float[Array, "..."], Float[Array, "..."]]:
    """`ŝ^p(x)`, eq. (78), and its slope by one power.

    The paper's power with a linear core: `ŝ^p(x) = sig^p(x) = |x|^p sgn(x)` for `|x| >= delta`, else `delta^(p-1) x`.
    Odd, increasing and continuous; its slope jumps at `|x| = delta` from `delta^(p-1)` inside to `p delta^(p-1)`
    outside, where the outer one is returned.

    With `w = max(|x|, delta)^(p-1)`, both branches are `x w`, and the slopes are `w` inside and `p w` outside.

    - `x`: any real array.
    - `p`: exponent in (0, 1), broadcast with `x`.
    - `delta`: half-width of the core, in (0, 1], broadcast with `x`.
    """
    magnitude = jnp.abs(x)
    inside = magnitude < delta
    w = power(jnp.where(inside, delta, magnitude), p - 1.0)
    return x * w, jnp.where(inside, w, p * w)


def two_term_power_and_slope(
    x: Float[Array, "..."], a: Float[Array, "..."], r: Float[Array, "..."], delta: Float[Array, "..."]
) -> tuple[Float[Array, "..."], Float[Array, "..."]]:
    """`S_a(x)` and its slope by two powers.

    `S_a(x) = sig^a(x) = |x|^a sgn(x)` for `|x| >= delta`, else `l1 x + l2 sig^r(x)` with `l1 = (r-a)/(r-1) delta^(a-1)`
    and `l2 = (a-1)/(r-1) delta^(a-r)`. Odd, increasing, and continuously differentiable at `|x| = delta`.

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


def saturation(x: Float[Array, "..."], width: Float[Array, "..."]) -> Float[Array, "..."]:
    """`sat(x/width)`: `x/width` for `|x| <= width`, else `sgn(x)`, elementwise; for `width = 0` it is `sgn(x)`.

    - `x`: any real array.
    - `width`: half-width of the linear range, >= 0, broadcast with `x`.
    """
    wide = width > 0
    straight = jnp.clip(x / jnp.where(wide, width, 1.0), -1.0, 1.0)
    return jnp.where(wide, straight, jnp.sign(x))


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


def unit_vector(x: Vector, layer: Scalar) -> Vector:
    """`x/(‖x‖ + layer)`, [n], and 0 at x = 0.

    - `x`: vector [n].
    - `layer`: boundary layer >= 0, in the unit of `x`; 0 gives the unit vector.
    """
    size = vector_norm(x) + layer
    return x / jnp.where(size > 0, size, 1.0)


def tangent_mask(primals: Any, tangents: Any) -> Any:
    """Return a pytree of bools with the structure of `primals`: True for each leaf that has a tangent.

    - `tangents`: tangents in a rule of `eqx.filter_custom_jvp`, None for constants.
    """
    return jax.tree.map(lambda p, d: d is not None, primals, tangents, is_leaf=lambda x: x is None)
