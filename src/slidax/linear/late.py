"""A delayed sensor whose past states are ordered by age."""

from __future__ import annotations

import math

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from slidax.parts import Memory, Scalar, State, parameter, piece
from slidax.sensors import AbstractSensor, Measurement


class Past(eqx.Module):
    """The memory of `Late`.

    - `q`, `dq`: the last states, the newest first [m n].
    - `inner`: the memory of the sensor that is late.
    """

    q: Float[Array, "m n"]
    dq: Float[Array, "m n"]
    inner: Memory


class Late(AbstractSensor):
    """`slidax.sensors.Delayed` without jitter, as a shift register.

    That one keeps the states in a ring, whose places mean something else in
    each period, so that no one matrix is its period; here the newest stands first.
    """

    sensor: AbstractSensor = piece("what measures")
    periods: float = parameter("the delay, whole or not", "sampling periods", "[0, 100]", static=True)

    def init(self, state: State) -> Past:
        shape = (math.ceil(self.periods) + 1, *state.q.shape)
        return Past(jnp.broadcast_to(state.q, shape), jnp.broadcast_to(state.dq, shape), self.sensor.init(state))

    def __call__(self, k: Int[Array, ""], state: State, period: Scalar, memory: Past) -> tuple[Measurement, Past]:
        q, dq = (jnp.concatenate([new[None], old[:-1]]) for new, old in ((state.q, memory.q), (state.dq, memory.dq)))
        whole, back = math.floor(self.periods), self.periods % 1.0
        past = State(q=q[whole], dq=dq[whole])
        if back:
            q1, v1, v0 = q[whole], dq[whole], dq[whole + 1]
            mean = (q1 - q[whole + 1]) / period
            square, cube = 2.0 * v1 + v0 - 3.0 * mean, 2.0 * mean - v1 - v0
            past = State(
                q=q1 + period * back * (back * (square + back * cube) - v1),
                dq=v1 - back * (2.0 * square + 3.0 * back * cube),
            )
        past = jax.tree.map(jnp.asarray, past)
        measurement, inner = self.sensor(k, past, period, memory.inner)
        return measurement, Past(q=q, dq=dq, inner=inner)
