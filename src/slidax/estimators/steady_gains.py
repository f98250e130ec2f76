"""Steady-state gains of a Kalman filter for position, velocity and push."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from slidax._errors import DefinitionError, as_array, is_traced
from slidax._types import Scalar

# Enough for a filter that takes 1e8 periods to settle.
DOUBLINGS = 32

Three = Float[Array, "3 3"]


def steady_gains(density: Any, variance: Any, period: Any) -> Float[Array, "..."]:
    """The steady-state gains [3] or [3 n] for `q⃛ = w`, with w white, and a position measured once a period.

    They are dimensionless, times 1, 1/h and 1/h², functions of `density h⁵/variance` alone.

    - `density`: spectral density of w, one number or [n], (rad/s³)² s or (m/s³)² s, > 0.
    - `variance`: of the measured position, one number or [n], rad² or m², > 0.
    - `period`: h [s], > 0.

    Raises DefinitionError if one of them is out of its range.
    """
    values = [as_array(value) for value in (density, variance, period)]
    for name, value, unit in zip(("density", "variance", "period"), values, ("rad²/s⁵", "rad²", "s"), strict=True):
        if not is_traced(value) and not np.all((np.asarray(value) > 0) & np.isfinite(value)):
            raise DefinitionError(f"`{name}` of a Kalman filter must be > 0 {unit} and finite; got {value}")
    spread, noise, h = jnp.broadcast_arrays(*values)
    return _steady(spread, noise, h)


# As one program: JAX would compile each of its operations alone, which takes a second.
@jax.jit
def _steady(spread: Any, noise: Any, h: Any) -> Any:
    # No arm reaches the ends of this range; they keep the matrices regular.
    ratio = jnp.clip(spread / noise * h * h * h * h * h, 1e-42, 1e24)
    gains = jax.vmap(_gains)(ratio.reshape(-1)).T.reshape(3, *ratio.shape)
    return gains / jnp.stack([jnp.ones_like(h), h, h * h])


def _gains(ratio: Scalar) -> Float[Array, "3"]:
    """The gains for a period of 1 and a variance of 1.

    The unit of time is about the settling time of the filter, so that the matrices are well conditioned however slow it
    is: a step is then `d = ratio^(1/6)`, or 1 for a fast one.
    """
    d = jnp.minimum(ratio ** (1.0 / 6.0), 1.0)
    unit, nil = jnp.ones_like(d), jnp.zeros_like(d)
    moved = _matrix([unit, d, 0.5 * d * d], [nil, unit, d], [nil, nil, unit])
    d2, d3 = d * d, d * d * d
    drift = _matrix([d2 * d3 / 20, d2 * d2 / 8, d3 / 6], [d2 * d2 / 8, d3 / 3, d2 / 2], [d3 / 6, d2 / 2, d])
    covariance = _steady_covariance(moved, drift * (ratio / (d2 * d3)))
    return covariance[0] / (covariance[0, 0] + 1.0) * jnp.stack([unit, d, d2])


def _steady_covariance(f: Three, q: Three) -> Three:
    """The P with `P = F (P - P hᵀ h P/(h P hᵀ + 1)) Fᵀ + Q`, `h = (1, 0, 0)`: that of the prediction.

    By doubling: each step joins two equal numbers of samples into one, so that it converges quadratically (Anderson
    1978; Chu, Fan, Lin and Wang, 2004).
    """
    measured = _matrix([1.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0])
    return jax.lax.fori_loop(0, DOUBLINGS, _twice, (f.T, measured, q))[2]


# By itself, and not within what calls it: jax compiles a loop again for each function that it has not seen.
def _twice(_: Any, agh: tuple[Three, Three, Three]) -> tuple[Three, Three, Three]:
    a, g, h = agh
    solved = _product(_inverse(jnp.eye(3) + _product(g, h)), jnp.concatenate([a, _product(g, a.T)], axis=1))
    onward, back = solved[:, :3], solved[:, 3:]
    return (
        _product(a, onward),
        _symmetric(g + _product(a, back)),
        _symmetric(h + _product(_product(a.T, h), onward)),
    )


def _matrix(*rows: list[Any]) -> Three:
    return jnp.stack([jnp.stack([jnp.asarray(entry, float) for entry in row]) for row in rows])


def _product(a: Three, b: Float[Array, "3 m"]) -> Float[Array, "3 m"]:
    return jnp.sum(a[:, :, None] * b[None, :, :], axis=1)


def _symmetric(a: Three) -> Three:
    return 0.5 * (a + a.T)


def _inverse(a: Three) -> Three:
    """By cofactors, which are the cross products of the rows."""
    cofactors = jnp.stack([jnp.cross(a[1], a[2]), jnp.cross(a[2], a[0]), jnp.cross(a[0], a[1])])
    return cofactors.T / jnp.sum(a[0] * cofactors[0])
