"""The classical fourth-order Runge-Kutta step."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

import jax

from slidax._types import Scalar

Watch = TypeVar("Watch")


def runge_kutta_4(
    rate: Callable[[Scalar, Any], tuple[Any, Watch]], t: Scalar, state: Any, h: Scalar
) -> tuple[Any, tuple[Watch, ...]]:
    """The classical Runge-Kutta step: order 4, four evaluations at t, t + h/2 (twice) and t + h.

    - `rate`: from time and state to (the state's time derivative, what to watch).
    - `t`: time at the step's start [s].
    - `state`: state at the step's start: any pytree.
    - `h`: step [s].

    Returns the state at `t + h`, and what was watched at each of the four evaluations, in order.
    """

    def moved(slope: Any, by: Scalar) -> Any:
        return jax.tree.map(lambda y, dy: y + by * dy, state, slope)

    half = 0.5 * h
    k1, watch1 = rate(t, state)
    k2, watch2 = rate(t + half, moved(k1, half))
    k3, watch3 = rate(t + half, moved(k2, half))
    k4, watch4 = rate(t + h, moved(k3, h))
    mean = jax.tree.map(lambda a, b, c, d: (a + 2.0 * b + 2.0 * c + d) / 6.0, k1, k2, k3, k4)
    return moved(mean, h), (watch1, watch2, watch3, watch4)
