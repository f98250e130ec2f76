"""What an encoder counts."""

from __future__ import annotations

import jax.numpy as jnp

from slidax.parts import PerJoint, Vector


def rounded(q: Vector, resolution: PerJoint) -> Vector:
    """`r round(q/r)`, the nearest multiple of the resolution, [n]; q itself for `r = 0`.

    - `q`: positions [n].
    - `resolution`: r, in the unit of q, one number or [n], >= 0.
    """
    # From 2^52 steps on, there is no number between two multiples left to round; the quotient could even overflow.
    counts = jnp.abs(q) < resolution * 2.0**52
    step = jnp.where(counts, resolution, 1.0)
    return jnp.where(counts, step * jnp.round(jnp.where(counts, q, 0.0) / step), q)
