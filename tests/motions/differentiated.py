"""Derivatives of a trajectory at many times, for tests."""

from functools import cache, partial

import jax
import jax.numpy as jnp
import numpy as np


@cache
def compiled(order):
    def function(motion, t):
        place = motion.position
        for _ in range(order):
            place = partial(lambda inner, t: jax.jvp(inner, (t,), (jnp.ones_like(t),))[1], place)
        return place(t)

    return jax.jit(jax.vmap(function, in_axes=(None, 0)))


def derivative(motion, order, t):
    """A derivative of the position at each of the times, [times n]; of order 0 the position itself."""
    return np.asarray(compiled(order)(motion, jnp.asarray(t)))
