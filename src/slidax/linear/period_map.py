"""One period of a closed loop as a function of what it keeps and what enters, with its derivative."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree

from slidax.codegen import NoNativeCodeError, compile, trace
from slidax.simulation.loop import Carry, Loop
from slidax.simulation.rollout import sample

from .injected import OF_THE_LAW, Signals, injected, standing

INPUTS = tuple(Signals.__annotations__)
OUTPUTS = ("error", "torque", "position", "velocity")
"""Outputs of the map at the sample: e, the law's command, and the true state that a sensor receives."""


@dataclass(frozen=True, eq=False)
class PeriodMap:
    """`x⁺, y = f(x, u)` at one sample; x are all numbers that the loop keeps.

    - `x`: what it keeps there [m].
    - `inputs`: how many numbers u has, n of each of `INPUTS`.
    - `outputs`: how many y has, n of each of `OUTPUTS`.
    - `evaluate`: from x and u, and a direction of both, to x⁺ and y, and their slope in it [m + outputs].
    """

    x: np.ndarray
    inputs: int
    outputs: int
    evaluate: Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]

    def derivative(self) -> np.ndarray:
        """All slopes at x and no input, [m + outputs, m + inputs]."""
        here = np.concatenate([self.x, np.zeros(self.inputs)])
        return np.stack([self.evaluate(here, direction)[1] for direction in np.eye(here.size)], axis=1)

    def differences(self, steps: np.ndarray) -> np.ndarray:
        """The same by central differences of the simulated sample itself.

        - `steps`: how far to go along each number [m + inputs].
        """
        here = np.concatenate([self.x, np.zeros(self.inputs)])
        nothing = np.zeros_like(here)
        columns = []
        for k, step in enumerate(steps):
            ends = []
            for side in (step, -step):
                there = here.copy()
                there[k] += side
                ends.append(self.evaluate(there, nothing)[0])
            columns.append((ends[0] - ends[1]) / (2.0 * step))
        return np.stack(columns, axis=1)


def period_map(loop: Loop, carry: Carry) -> PeriodMap:
    """One period of a loop.

    - `carry`: what it has before the sample.
    """
    controller, memory = standing(loop.controller, carry.memory)
    loop = eqx.tree_at(lambda x: x.controller, loop, controller)
    carry = eqx.tree_at(lambda c: c.memory, carry, memory)
    # Only what acts on what comes after: no statistics.
    moving = (carry.state, carry.memory, carry.sensor, carry.actuator, carry.torque)
    floats, others = eqx.partition(moving, eqx.is_inexact_array)
    x, unravel = ravel_pytree(floats)
    n = carry.state.q.size
    inputs = len(INPUTS) * n

    arrays, rest = eqx.partition((loop, others, carry), eqx.is_array)

    def after(arrays: Any, xu: jax.Array) -> jax.Array:
        loop, others, carry = eqx.combine(arrays, rest)
        state, memory, sensor, actuator, torque = eqx.combine(unravel(xu[: x.size]), others)
        signals = Signals(*(xu[x.size :].reshape(len(INPUTS), n)))
        before = eqx.tree_at(
            lambda c: (c.state, c.memory, c.sensor, c.actuator, c.torque),
            carry,
            (state, memory, sensor, actuator, torque),
            is_leaf=lambda leaf: leaf is None,
        )
        loop = injected(loop, signals)
        then, log = sample(loop, before)
        kept = (then.state, then.memory, then.sensor, then.actuator, then.torque)
        moved = ravel_pytree(eqx.filter(kept, eqx.is_inexact_array))[0]
        y = [log.e, log.signals[OF_THE_LAW], state.q, state.dq]
        return jnp.concatenate([moved, *y])

    def with_slope(arrays: Any, xu: jax.Array, direction: jax.Array) -> tuple[jax.Array, jax.Array]:
        value, slope = jax.jvp(lambda xu: after(arrays, xu), (xu,), (direction,))
        return value, slope

    return PeriodMap(
        x=np.asarray(x),
        inputs=inputs,
        outputs=len(OUTPUTS) * n,
        evaluate=_compiled(with_slope, arrays, x.size + inputs),
    )


def _compiled(
    function: Any, arrays: Any, size: int
) -> Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]:
    """By machine code of our own, which is made in seconds; where that cannot be, by XLA."""
    known = [np.asarray(leaf) for leaf in jax.tree.leaves(arrays)]
    shapes = jax.tree.map(lambda leaf: jax.ShapeDtypeStruct(leaf.shape, leaf.dtype), arrays)
    numbers = jax.ShapeDtypeStruct((size,), float)
    try:
        kernel = compile(trace(function, shapes, numbers, numbers, named=False))
    except (NoNativeCodeError, ImportError):
        jitted = jax.jit(function)

        def by_xla(xu: np.ndarray, direction: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            value, slope = jitted(arrays, jnp.asarray(xu), jnp.asarray(direction))
            return np.asarray(value), np.asarray(slope)

        return by_xla

    def natively(xu: np.ndarray, direction: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        value, slope = kernel([*known, xu, direction])
        return value, slope

    return natively
