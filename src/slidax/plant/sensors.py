"""Sensors: exact, rounded, noisy, delayed or lossy measurements of the true state."""

from __future__ import annotations

import math
from abc import abstractmethod

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from slidax.core.errors import DefinitionError
from slidax.core.parameter import parameter, piece
from slidax.core.part import AbstractPart
from slidax.core.types import Memory, PerJoint, Scalar, State, Vector

from .noise import DELAYED, DIFFERENCED_ENCODERS, ENCODERS, LOSSY, as_integer, draw_normal, draw_uniform, seed


class Measurement(eqx.Module):
    """Measurement at one sample.

    - `state`: measured positions and velocities.
    - `fresh`: False if this sample was lost; `state` is then the last one that arrived.
    """

    state: State
    fresh: Bool[Array, ""]


class AbstractSensor(AbstractPart):
    """Map from the true state at a sample to a measurement.

    A sensor is a pure function: its random numbers depend only on a seed and the sample's number. Call a sensor at
    every sample, in order, from number 0 on.
    """

    @abstractmethod
    def init(self, state: State) -> Memory:
        """Return the sensor's memory before the first sample: any pytree of arrays, also an empty one.

        - `state`: true positions and velocities at sample 0.
        """

    @abstractmethod
    def __call__(self, k: Int[Array, ""], state: State, period: Scalar, memory: Memory) -> tuple[Measurement, Memory]:
        """Return the measurement at sample k, and the memory after it, a pytree like `memory`.

        - `k`: number of the sample, from 0 on.
        - `state`: true positions and velocities at sample k.
        - `period`: time between two samples [s], > 0.
        - `memory`: from `init`, or from the call at the last sample.
        """


class Exact(AbstractSensor):
    """Measures the true state, without delay or loss."""

    title = "A sensor without errors."

    def init(self, state: State) -> tuple[()]:
        return ()

    def __call__(
        self, k: Int[Array, ""], state: State, period: Scalar, memory: tuple[()]
    ) -> tuple[Measurement, tuple[()]]:
        return Measurement(state=state, fresh=jnp.asarray(True)), ()


@jax.custom_jvp
def round_to_resolution(q: Vector, resolution: PerJoint) -> Vector:
    """`r round(q/r)`, the nearest multiple of the resolution, [n]; q itself for `r = 0`.

    Its derivative with respect to q is 1 (a straight-through estimator), since the staircase itself has a slope of 0. A
    gradient through encoders is therefore that of the loop without rounding, along the motion with rounding. The
    derivative with respect to the resolution is 0.

    - `q`: positions [n].
    - `resolution`: r, in the unit of q, one number or [n], >= 0.
    """
    # From 2^52 steps on, every floating-point number is a multiple; the quotient could even overflow.
    counts = jnp.abs(q) < resolution * 2.0**52
    step = jnp.where(counts, resolution, 1.0)
    return jnp.where(counts, step * jnp.round(jnp.where(counts, q, 0.0) / step), q)


@round_to_resolution.defjvp
def _straight_through(primals: tuple[Vector, PerJoint], tangents: tuple[Vector, PerJoint]) -> tuple[Vector, Vector]:
    counted = round_to_resolution(*primals)
    return counted, jnp.broadcast_to(tangents[0], counted.shape)


class Encoders(AbstractSensor):
    """`q' = r round((q + σ_q ν)/r)`, `q̇' = q̇ + σ_v ν'`, where ν and ν' are white with mean 0 and deviation 1.

    The velocity has its own sensor, such as a tachometer. For drives that difference their encoder, use
    `DifferencedEncoders`.
    """

    title = "Position encoders with velocity sensors."

    resolution: PerJoint = parameter("r, 2π over the counts per turn", "rad or m", ">= 0", "(0 for none)")
    position_noise: PerJoint = parameter(
        "σ_q, standard deviation before rounding", "rad or m", ">= 0", "(0 for none)", default=0.0
    )
    velocity_noise: PerJoint = parameter("σ_v, standard deviation", "rad/s or m/s", ">= 0", "(0 for none)", default=0.0)
    seed: Int[Array, ""] = seed("noise")

    def init(self, state: State) -> tuple[()]:
        return ()

    def __call__(
        self, k: Int[Array, ""], state: State, period: Scalar, memory: tuple[()]
    ) -> tuple[Measurement, tuple[()]]:
        """Rounded positions and noisy velocities."""
        noise = draw_normal(self.seed, ENCODERS, k, (2, *state.q.shape))
        measured = State(
            q=round_to_resolution(state.q + self.position_noise * noise[0], self.resolution),
            dq=state.dq + self.velocity_noise * noise[1],
        )
        return Measurement(state=measured, fresh=jnp.asarray(True)), ()


class DifferencedEncoders(AbstractSensor):
    """`q' = r round((q + σ ν)/r)`, and `v⁺ = v + (1 - e^{-c h}) ((q' - q'₋)/h - v)`, `q̇' = v⁺`.

    There is no velocity sensor: the velocity is the difference of the last two positions after a first-order low-pass,
    and lags by about `1/c + h/2`. At sample 0 it is the true velocity. q'₋ and v are the values of the last sample, h
    is the period, and ν is white with mean 0 and deviation 1.
    """

    title = "Encoders without velocity sensors: the velocity is a filtered difference of positions."

    resolution: PerJoint = parameter("r, 2π over the counts per turn", "rad or m", ">= 0", "(0 for none)")
    position_noise: PerJoint = parameter(
        "σ, standard deviation before rounding", "rad or m", ">= 0", "(0 for none)", default=0.0
    )
    cutoff: PerJoint = parameter("c, cut-off of the low-pass", "rad/s", "> 0", default=600.0)
    seed: Int[Array, ""] = seed("noise")

    def init(self, state: State) -> State:
        """The last measured position and the filtered velocity; both start at the true values."""
        return state

    def __call__(self, k: Int[Array, ""], state: State, period: Scalar, memory: State) -> tuple[Measurement, State]:
        """Rounded positions, and the velocities that follow from them."""
        noise = draw_normal(self.seed, DIFFERENCED_ENCODERS, k, state.q.shape)
        q = round_to_resolution(state.q + self.position_noise * noise, self.resolution)
        share = -jnp.expm1(-self.cutoff * period)
        moved = memory.dq + share * ((q - memory.q) / period - memory.dq)
        measured = State(q=q, dq=jnp.where(k > 0, moved, memory.dq))
        return Measurement(state=measured, fresh=jnp.asarray(True)), measured


class DelayedMemory(eqx.Module):
    """Memory of a `Delayed` sensor.

    - `start`: the state at sample 0.
    - `q`, `dq`: the last m states [m n], with m = `Delayed.stored`; row k mod m is the state at sample k.
    - `inner`: the memory of the delayed sensor.
    """

    start: State
    q: Float[Array, "m n"]
    dq: Float[Array, "m n"]
    inner: Memory


class Delayed(AbstractSensor):
    """Measurement of `sensor`, delayed by `max(periods + jitter U, 0)` sampling periods.

    U is uniform in [-1/2, 1/2) and drawn for each sample, so that the sampling instants are uneven. Between two samples
    the state is interpolated by a cubic Hermite polynomial. With the sampling period h, its error is of order `h⁴` in
    the position and `h³` in the velocity. Before sample 0 the velocity is constant.
    """

    sensor: AbstractSensor = piece("the delayed sensor")
    periods: float = parameter(
        "the delay, also fractional; a new value recompiles the loop, since it sets the number of stored states",
        "sampling periods",
        "[0, 100]",
        static=True,
        converter=float,
    )
    jitter: float = parameter(
        "width of the delay's distribution; a new value recompiles the loop",
        "sampling periods",
        "[0, 100]",
        default=0.0,
        static=True,
        converter=float,
    )
    seed: Int[Array, ""] = seed("instants")

    @property
    def stored(self) -> int:
        """m, the number of stored states."""
        return math.ceil(self.periods + 0.5 * self.jitter) + 1

    def init(self, state: State) -> DelayedMemory:
        """Memory filled with the first state."""
        shape = (self.stored, *state.q.shape)
        return DelayedMemory(
            start=state,
            q=jnp.broadcast_to(state.q, shape),
            dq=jnp.broadcast_to(state.dq, shape),
            inner=self.sensor.init(state),
        )

    def __call__(
        self, k: Int[Array, ""], state: State, period: Scalar, memory: DelayedMemory
    ) -> tuple[Measurement, DelayedMemory]:
        """Measurement of the delayed state."""
        row = k % self.stored
        q, dq = memory.q.at[row].set(state.q), memory.dq.at[row].set(state.dq)
        measurement, inner = self.sensor(k, self._past(k, q, dq, period, memory.start), period, memory.inner)
        return measurement, DelayedMemory(start=memory.start, q=q, dq=dq, inner=inner)

    def _past(
        self, k: Int[Array, ""], q: Float[Array, "m n"], dq: Float[Array, "m n"], period: Scalar, start: State
    ) -> State:
        """Return the state that sample k measures, interpolated at its age."""
        age = jnp.asarray(self.periods)
        if self.jitter:
            age = jnp.maximum(age + self.jitter * (draw_uniform(self.seed, DELAYED, k) - 0.5), 0.0)
        whole_age = jnp.floor(age)
        later = (k - whole_age.astype(k.dtype)) % self.stored
        earlier = (later - 1) % self.stored
        # Interpolate back from the later sample, so that integer ages are exact.
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


class LossyMemory(eqx.Module):
    """Memory of a `Lossy` sensor.

    - `last`: the last state that arrived.
    - `inner`: the memory of the inner sensor.
    """

    last: State
    inner: Memory


class Lossy(AbstractSensor):
    """Measurement of `sensor`, of which some samples are lost.

    Sample k is lost by chance (`probability`), in an outage (`start <= k < start + count`), or if `pattern[k mod p]` is
    1 in a pattern of length p. Sample 0 always arrives. A lost sample is not fresh, and repeats the last sample that
    arrived. The inner sensor continues to measure.
    """

    sensor: AbstractSensor = piece("the inner sensor")
    probability: Scalar = parameter("probability of losing a sample, independent of others", "", "[0, 1]", default=0.0)
    starts: Int[Array, " m"] = parameter("number of the first sample of each outage", default=(), converter=as_integer)
    counts: Int[Array, " m"] = parameter(
        "number of samples in each outage", "samples", ">= 0", default=(), converter=as_integer
    )
    seed: Int[Array, ""] = seed("losses")
    pattern: Int[Array, " p"] = parameter(
        "1 for each lost sample of a sequence that repeats", "", "[0, 1]", default=(), converter=as_integer
    )

    def __check_init__(self) -> None:
        if self.starts.ndim != 1 or self.starts.shape != self.counts.shape:
            raise DefinitionError(
                "`Lossy.counts` must have one entry for each of `starts`; "
                f"got shapes {list(self.counts.shape)} and {list(self.starts.shape)}"
            )

    def init(self, state: State) -> LossyMemory:
        """Memory before sample 0, which always arrives and replaces the first state in it."""
        return LossyMemory(last=state, inner=self.sensor.init(state))

    def __call__(
        self, k: Int[Array, ""], state: State, period: Scalar, memory: LossyMemory
    ) -> tuple[Measurement, LossyMemory]:
        """Measurement at sample k, or the last one that arrived."""
        measurement, inner = self.sensor(k, state, period, memory.inner)
        by_chance = draw_uniform(self.seed, LOSSY, k) < self.probability
        since = k.astype(self.starts.dtype) - self.starts
        by_plan = jnp.any((since >= 0) & (since < self.counts))
        if self.pattern.size:
            by_plan |= self.pattern[k % self.pattern.size] > 0
        fresh = measurement.fresh & ((k == 0) | ~(by_chance | by_plan))
        last = jax.tree.map(lambda new, old: jnp.where(fresh, new, old), measurement.state, memory.last)
        return Measurement(state=last, fresh=fresh), LossyMemory(last=last, inner=inner)
