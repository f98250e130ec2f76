"""A sensor with delay and jitter."""

from __future__ import annotations

import math

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from slidax.parts import Memory, Scalar, State, parameter, piece

from .chance import DELAYED, seed, uniform
from .sensor import AbstractSensor, Measurement


class History(eqx.Module):
    """The memory of `Delayed`.

    - `start`: the state at sample 0.
    - `q`, `dq`: the last states [m n]; that of sample k is in row k mod m.
    - `inner`: the memory of the delayed sensor.
    """

    start: State
    q: Float[Array, "m n"]
    dq: Float[Array, "m n"]
    inner: Memory


class Delayed(AbstractSensor):
    """Measurement of `sensor`, delayed by `max(periods + jitter U, 0)` sampling periods.

    U is uniform in [-1/2, 1/2) and drawn anew for each sample: the sampling instants are uneven. Between two samples
    the state follows the cubic polynomial that has both positions and velocities there (Hermite), an error of `h⁴` in
    the position and `h³` in the velocity; before sample 0 the velocity was constant.
    """

    sensor: AbstractSensor = piece("what measures")
    periods: float = parameter(
        "the delay, whole or not; known when compiled, since it sets how much is kept",
        "sampling periods",
        "[0, 100]",
        static=True,
        converter=float,
    )
    jitter: float = parameter(
        "width of the spread of the delay; known when compiled",
        "sampling periods",
        "[0, 100]",
        default=0.0,
        static=True,
        converter=float,
    )
    seed: Int[Array, ""] = seed("instants")

    @property
    def kept(self) -> int:
        """m, the number of stored states."""
        return math.ceil(self.periods + 0.5 * self.jitter) + 1

    def init(self, state: State) -> History:
        """A history of the first state."""
        shape = (self.kept, *state.q.shape)
        return History(
            start=state,
            q=jnp.broadcast_to(state.q, shape),
            dq=jnp.broadcast_to(state.dq, shape),
            inner=self.sensor.init(state),
        )

    def __call__(self, k: Int[Array, ""], state: State, period: Scalar, memory: History) -> tuple[Measurement, History]:
        """Measurement of the delayed state."""
        row = k % self.kept
        q, dq = memory.q.at[row].set(state.q), memory.dq.at[row].set(state.dq)
        measurement, inner = self.sensor(k, self._past(k, q, dq, period, memory.start), period, memory.inner)
        return measurement, History(start=memory.start, q=q, dq=dq, inner=inner)

    def _past(
        self, k: Int[Array, ""], q: Float[Array, "m n"], dq: Float[Array, "m n"], period: Scalar, start: State
    ) -> State:
        """The state at the age of this sample."""
        age = jnp.asarray(self.periods)
        if self.jitter:
            age = jnp.maximum(age + self.jitter * (uniform(self.seed, DELAYED, k) - 0.5), 0.0)
        whole_age = jnp.floor(age)
        later = (k - whole_age.astype(k.dtype)) % self.kept
        earlier = (later - 1) % self.kept
        # From the later sample back by a share of the period, so that whole ages are exact.
        back = age - whole_age
        q1, v1, v0 = q[later], dq[later], dq[earlier]
        mean = (q1 - q[earlier]) / period
        square, cube = 2.0 * v1 + v0 - 3.0 * mean, 2.0 * mean - v1 - v0
        between = State(
            q=q1 + period * back * (back * (square + back * cube) - v1),
            dq=v1 - back * (2.0 * square + 3.0 * back * cube),
        )
        before = jnp.maximum(age - k.astype(age.dtype), 0.0) * period
        return State(
            q=jnp.where(before > 0, start.q - before * start.dq, between.q),
            dq=jnp.where(before > 0, start.dq, between.dq),
        )
