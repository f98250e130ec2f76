"""The semi-implicit (symplectic) Euler step."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar


from slidax._types import Scalar, State

Watch = TypeVar("Watch")


def semi_implicit_euler(
    rate: Callable[[Scalar, State], tuple[State, Watch]], t: Scalar, state: State, h: Scalar
) -> tuple[State, tuple[Watch, ...]]:
    """`q̇⁺ = q̇ + h q̈(t, q, q̇)`, `q⁺ = q + h q̇⁺`: order 1, one evaluation.

    - `rate`: from time and state to (`State(dq, ddq)`, what to watch).
    - `t`: time at the step's start [s].
    - `state`: state at the step's start.
    - `h`: step [s].

    Returns the state at `t + h`, and what was watched at each evaluation, in order.
    """
    slope, watch = rate(t, state)
    dq = state.dq + h * slope.dq
    return State(q=state.q + h * dq, dq=dq), (watch,)
