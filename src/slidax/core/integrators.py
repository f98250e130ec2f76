"""Integration steps and time derivatives."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp

from .errors import as_array
from .types import PerJoint, Scalar

Watch = TypeVar("Watch")

MAX_UNROLLED = 8
"""Largest number of state entries for which the four stages are unrolled. For a larger state they are a loop with the
same results: four copies of the arm's code exceed the CPU's instruction cache, and take three times as long to compile
and run."""


def runge_kutta_4(
    rate: Callable[[Scalar, Any], tuple[Any, Watch]], t: Scalar, state: Any, h: Scalar
) -> tuple[Any, tuple[Watch, ...]]:
    """Take a classical Runge-Kutta step: order 4, four evaluations at t, t + h/2 (twice) and t + h.

    - `rate`: function of time and state that returns (the state's time derivative, values to record).
    - `t`: time at the step's start [s].
    - `state`: state at the step's start: any pytree.
    - `h`: step [s].

    Returns the state at `t + h`, and the recorded values of the four evaluations, in order.
    """

    def moved(slope: Any, by: Scalar) -> Any:
        return jax.tree.map(lambda y, dy: y + by * dy, state, slope)

    if sum(leaf.size for leaf in jax.tree.leaves(state)) > MAX_UNROLLED:
        return _rolled(rate, t, state, h)
    half = 0.5 * h
    k1, watch1 = rate(t, state)
    k2, watch2 = rate(t + half, moved(k1, half))
    k3, watch3 = rate(t + half, moved(k2, half))
    k4, watch4 = rate(t + h, moved(k3, h))
    mean = jax.tree.map(lambda a, b, c, d: (a + 2.0 * b + 2.0 * c + d) / 6.0, k1, k2, k3, k4)
    return moved(mean, h), (watch1, watch2, watch3, watch4)


def _rolled(
    rate: Callable[[Scalar, Any], tuple[Any, Watch]], t: Scalar, state: Any, h: Scalar
) -> tuple[Any, tuple[Watch, ...]]:
    def stage(before: tuple[Any, Any], now: tuple[Scalar, Scalar]) -> tuple[tuple[Any, Any], Watch]:
        (slope, total), (by, weight) = before, now
        slope, watch = rate(t + by, jax.tree.map(lambda y, dy: y + by * dy, state, slope))
        return (slope, jax.tree.map(lambda sum, dy: sum + weight * dy, total, slope)), watch

    half, zero = 0.5 * h, jnp.zeros_like(h)
    still = jax.tree.map(jnp.zeros_like, state)
    stages = jnp.stack([zero, half, half, h]), jnp.asarray([1.0, 2.0, 2.0, 1.0])
    (_, total), watches = jax.lax.scan(stage, (still, still), stages)
    end = jax.tree.map(lambda y, sum: y + h * (sum / 6.0), state, total)
    return end, tuple(jax.tree.map(lambda watch, i=i: watch[i], watches) for i in range(4))


def semi_implicit_euler(
    rate: Callable[[Scalar, Any], tuple[Any, Watch]], t: Scalar, state: Any, h: Scalar
) -> tuple[Any, tuple[Watch, ...]]:
    """Take a semi-implicit Euler step: `q̇⁺ = q̇ + h q̈(t, q, q̇)`, `q⁺ = q + h q̇⁺`; order 1, one evaluation at t.

    - `rate`: function of time and state that returns (the state's time derivative, values to record).
    - `t`: time at the step's start [s].
    - `state`: state at the step's start: any pytree with fields `q` and `dq`; other fields follow Euler's rule.
    - `h`: step [s].

    Returns the state at `t + h`, and a tuple with the recorded values of the evaluation.
    """
    slope, watch = rate(t, state)
    moved = jax.tree.map(lambda y, dy: y + h * dy, state, slope)
    return eqx.tree_at(lambda y: y.q, moved, state.q + h * moved.dq), (watch,)


def value_rate_curvature(
    function: Callable[[Scalar], PerJoint], t: Scalar | float
) -> tuple[PerJoint, PerJoint, PerJoint]:
    """Value, slope and curvature of a function of time, `f(t), f'(t), f''(t)`, by two nested forward derivatives.

    - `function`: f, from a time [s] to an array.
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
