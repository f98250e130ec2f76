"""Rounding to an encoder's resolution."""

from __future__ import annotations

import jax
import jax.numpy as jnp

from slidax.parts import PerJoint, Vector


@jax.custom_jvp
def rounded(q: Vector, resolution: PerJoint) -> Vector:
    """`r round(q/r)`, the nearest multiple of the resolution, [n]; q itself for `r = 0`.

    Its derivative is that of q (a straight-through estimator): the staircase itself is flat between its steps, and
    would give a gradient of 0. A gradient through encoders is therefore that of the loop without rounding, along the
    motion with it; with respect to the resolution it is 0.

    - `q`: positions [n].
    - `resolution`: r, in the unit of q, one number or [n], >= 0.
    """
    # From 2^52 steps on, there is no number between two multiples left to round; the quotient could even overflow.
    counts = jnp.abs(q) < resolution * 2.0**52
    step = jnp.where(counts, resolution, 1.0)
    return jnp.where(counts, step * jnp.round(jnp.where(counts, q, 0.0) / step), q)


@rounded.defjvp
def _straight_through(primals: tuple[Vector, PerJoint], tangents: tuple[Vector, PerJoint]) -> tuple[Vector, Vector]:
    counted = rounded(*primals)
    return counted, jnp.broadcast_to(tangents[0], counted.shape)
