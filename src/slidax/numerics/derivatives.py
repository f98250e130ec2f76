"""First and second derivatives of a function of time."""

from __future__ import annotations

from collections.abc import Callable

import jax
import jax.numpy as jnp

from slidax._errors import as_array
from slidax._types import PerJoint, Scalar


def value_rate_curvature(
    function: Callable[[Scalar], PerJoint], t: Scalar | float
) -> tuple[PerJoint, PerJoint, PerJoint]:
    """`f(t), f'(t), f''(t)` by two nested forward derivatives.

    - `function`: from a time in s to an array.
    - `t`: time [s].
    """
    t = as_array(t)
    unit = jnp.ones_like(t)

    def value_and_rate(t: Scalar) -> tuple[PerJoint, PerJoint]:
        value: PerJoint
        rate: PerJoint
        value, rate = jax.jvp(function, (t,), (unit,))
        return value, rate

    (value, rate), (_, curvature) = jax.jvp(value_and_rate, (t,), (unit,))
    return value, rate, curvature
