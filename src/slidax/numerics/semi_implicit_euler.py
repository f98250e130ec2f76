"""The semi-implicit (symplectic) Euler step."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

import equinox as eqx
import jax

from slidax._types import Scalar

Watch = TypeVar("Watch")


def semi_implicit_euler(
    rate: Callable[[Scalar, Any], tuple[Any, Watch]], t: Scalar, state: Any, h: Scalar
) -> tuple[Any, tuple[Watch, ...]]:
    """`q̇⁺ = q̇ + h q̈(t, q, q̇)`, `q⁺ = q + h q̇⁺`: order 1, one evaluation.

    - `rate`: function of time and state that returns (the state's time derivative, values to record).
    - `t`: time at the step's start [s].
    - `state`: state at the step's start: any pytree with fields `q` and `dq`; other fields follow Euler's rule.
    - `h`: step [s].

    Returns the state at `t + h`, and the recorded values of each evaluation, in order.
    """
    slope, watch = rate(t, state)
    moved = jax.tree.map(lambda y, dy: y + h * dy, state, slope)
    return eqx.tree_at(lambda y: y.q, moved, state.q + h * moved.dq), (watch,)
