"""Streamed references: a host sends positions at its own rate, and a filter turns them into a smooth motion.

The filter runs once per sample of the control law, which is called the law below.
"""

from __future__ import annotations

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array
from numpy.typing import NDArray

from slidax.core.errors import DefinitionError, as_array, float_array, is_traced, require, short_repr
from slidax.core.parameter import parameter, piece
from slidax.core.part import AbstractPart
from slidax.core.types import PerJoint, Reference, Scalar, Vector

from .trajectory import AbstractPiecewisePolynomial, Rows

BRAKING = 0.5
"""Share of the acceleration limit that the filter's braking curve uses; the remainder is for corrections."""

JERK = 6.0
"""Bound of the filter's jerk without a jerk limit, in units of bandwidth times acceleration limit."""

TORQUE_SHARE = 0.5
"""Share of the drives' torque rate limit that a streamed motion may use; the remainder is for the law's feedback."""

MOST_SAMPLES = 4_000_000
"""Largest number of samples of a recorded stream: more than an hour at 1 kHz."""

AT_REST = 1e-12
"""Distance from the last position at which the motion ends, relative to the range of the stream's positions."""


class StreamState(NamedTuple):
    """State of the filter at a sample; each field is [n], except the scalar `left`.

    - `q`: position of the reference.
    - `dq`: velocity of the reference.
    - `ddq`: acceleration of the reference.
    - `goal`: position that the filter tracks; it moves at constant speed to `target`.
    - `target`: the host's newest position, clipped to the position limits.
    - `left`: sample periods until `goal` reaches `target`.
    """

    q: Vector
    dq: Vector
    ddq: Vector
    goal: Vector
    target: Vector
    left: Scalar


class StreamFilter(AbstractPart):
    """Third-order filter with limits: from streamed positions to a reference q with its derivatives.

    The jerk is constant during a period, so that the reference is one motion with exact derivatives at and between the
    samples. The goal p moves to the host's newest position during the host's period. Away from the limits the jerk is
    `j = K3 (K2/K3 (K1/K2 (p - q) - q̇) - q̈)`. The gains put all three poles of the sampled loop at `exp(-ω h)`; with
    `δ = 1 - exp(-ω h)` they are

        K1 = δ³/h³,   K2 = (3 δ² - δ³)/h²,   K3 = (3 δ - 3/2 δ² + 1/3 δ³)/h

    The limit V bounds the requested velocity `K1/K2 (p - q)`; far from the goal, a braking curve of constant
    deceleration replaces this term. The limit A bounds the requested acceleration `K2/K3 (K1/K2 (p - q) - q̇)`. The jerk
    is then bounded so that the inequalities

        |q̈| <= A,   -κ (V + q̇) <= q̈ <= κ (V - q̇),   κ = J/A,

    hold at the next sample. A jerk in [-J, J] that satisfies them always exists (proof in docs/streaming.md). The
    inequalities bound the velocity by V.
    """

    bandwidth: PerJoint = parameter("ω, pole of the filter", "rad/s", "> 0")
    velocity: PerJoint = parameter("V, velocity limit", "rad/s or m/s", "> 0")
    acceleration: PerJoint = parameter("A, acceleration limit", "rad/s² or m/s²", "> 0")
    jerk: PerJoint = parameter("J, jerk limit", "rad/s³ or m/s³", "> 0")
    period: Scalar = parameter("h, sample time of the law", "s", "> 0")
    wait: Scalar = parameter(
        "host's period, in periods of the law; during it the goal moves to the newest position", "", ">= 1"
    )
    lower: PerJoint = parameter("lower position limit", "rad or m", "[-inf, inf]", default=-np.inf)
    upper: PerJoint = parameter("upper position limit", "rad or m", "[-inf, inf]", default=np.inf)

    def __check_init__(self) -> None:
        a, j, w, h = self.acceleration, self.jerk, self.bandwidth, self.period
        if is_traced((a, j, w, h, self.lower, self.upper)):
            return
        require(self, "upper", np.asarray(self.upper >= self.lower), "must be at least `lower`", finite=False)
        require(self, "bandwidth", np.asarray(w * h <= 1.0), "must be at most 1/`period`", each="joint")
        slow = f"must be at least `bandwidth * acceleration` = {short_repr((w * a).tolist())}, to be able to brake"
        require(self, "jerk", np.asarray(j >= (1.0 - 1e-9) * w * a), slow, each="joint")
        fast = "must be at most `2 * acceleration / period`, so that no velocity exceeds its limit between two samples"
        require(self, "jerk", np.asarray(j <= (1.0 + 1e-9) * 2.0 * a / h), fast, each="joint")

    @staticmethod
    def fitting(
        *,
        bandwidth: object,
        velocity: object,
        acceleration: object,
        period: float,
        jerk: object = None,
        rate: float | None = None,
        lower: object = -np.inf,
        upper: object = np.inf,
    ) -> StreamFilter:
        """Return the filter for the law's sample time and the host's rate.

        - `period`: sample time of the law [s].
        - `jerk`: jerk limit; the default is so large that it never acts.
        - `rate`: the host's positions per second [Hz]; None holds each position until the next one.
        - `bandwidth`, `velocity`, `acceleration`, `lower`, `upper`: as in the class.

        Raises DefinitionError if a value is out of its range, or the host's rate exceeds that of the law.
        """
        if rate is not None and not 0.0 < rate * period <= 1.0 + 1e-9:
            raise DefinitionError(
                f"`rate` must be > 0 and at most the law's sampling rate, {1.0 / period:g} Hz; got {rate:g}: the law "
                "reads one position per sample"
            )
        w, a = as_array(bandwidth), as_array(acceleration)
        own = jnp.minimum(JERK * w * a, 2.0 * a / period) if jerk is None else as_array(jerk)
        wait = 1.0 if rate is None else max(1.0, float(np.round(1.0 / (rate * period))))
        return StreamFilter(*map(as_array, (w, velocity, a, own, period, wait, lower, upper)))

    @property
    def gains(self) -> tuple[PerJoint, PerJoint, PerJoint]:
        """The gains K1/K2, K2/K3 and K3 [1/s]."""
        h = self.period
        d = -jnp.expm1(-self.bandwidth * h)
        k2, k3 = d * d * (3.0 - d), d * (3.0 - 1.5 * d + d * d / 3.0)
        return d**3 / k2 / h, k2 / k3 / h, k3 / h

    def lag(self, speed: object) -> PerJoint:
        """Return the time by which the motion lags behind a stream of constant velocity [s].

        With the symbols of `StreamFilter`, the gain `k = K1/K2` and the braking deceleration `B = A/2`, the lag is
        `1/k = (3/δ - 1) h` up to the speed `B/k`. Above this speed, the braking curve determines the lag:
        `v/(2 B) + B/(2 k² v)`. The host's period less h is added in both cases.

        - `speed`: v, speed of the stream, >= 0, rad/s or m/s.
        """
        slow, brake = 1.0 / self.gains[0], BRAKING * self.acceleration
        v = jnp.maximum(as_array(speed), brake * slow)
        return v / (2.0 * brake) + brake * slow**2 / (2.0 * v) + (self.wait - 1.0) * self.period

    def begin(self, q: Vector, dq: Vector | None = None, ddq: Vector | None = None) -> StreamState:
        """Return the initial state for a position, velocity and acceleration [n]; by default at rest."""
        zero = jnp.zeros_like(q)
        return StreamState(q, zero if dq is None else dq, zero if ddq is None else ddq, q, q, jnp.zeros(()))

    def step(self, state: StreamState, target: Vector, fresh: Scalar) -> tuple[Reference, Reference, StreamState]:
        """Return the reference at this sample, the reference at the next sample, and the state at the next sample.

        - `target`: the host's newest position; a joint whose value is NaN or infinite keeps its previous target.
        - `fresh`: > 0 if the host has sent `target` since the previous sample.
        """
        h, limit, push = self.period, self.velocity, self.acceleration
        target = jnp.where(jnp.isfinite(target), target, state.target)
        target = jnp.minimum(jnp.maximum(target, self.lower), self.upper)
        left = jnp.where(fresh > 0.0, self.wait, state.left)
        goal = state.goal + (target - state.goal) / jnp.maximum(left, 1.0)
        first, second, third = self.gains

        away = goal - state.q
        brake = BRAKING * push
        size = jnp.abs(away)
        edge = brake / first**2
        curve = jnp.sqrt(2.0 * brake * jnp.maximum(size, edge) - (brake / first) ** 2)
        speed = jnp.minimum(jnp.where(size <= edge, first * size, curve), limit)
        ddq = second * (jnp.where(away < 0.0, -speed, speed) - state.dq)
        ddq = jnp.minimum(jnp.maximum(ddq, -push), push)
        jerk = third * (ddq - state.ddq)

        ratio = self.jerk / push
        room = h * (1.0 + 0.5 * ratio * h)
        ahead = state.dq + h * state.ddq
        most = jnp.minimum((push - state.ddq) / h, (ratio * (limit - ahead) - state.ddq) / room)
        least = jnp.maximum((-push - state.ddq) / h, (-ratio * (limit + ahead) - state.ddq) / room)
        jerk = jnp.maximum(jnp.minimum(jerk, jnp.minimum(most, self.jerk)), jnp.maximum(least, -self.jerk))

        after = StreamState(
            q=state.q + h * (state.dq + h * (0.5 * state.ddq + h / 6.0 * jerk)),
            dq=ahead + 0.5 * h * h * jerk,
            ddq=state.ddq + h * jerk,
            goal=goal,
            target=target,
            left=jnp.maximum(left - 1.0, 0.0),
        )
        return Reference(state.q, state.dq, state.ddq), Reference(after.q, after.dq, after.ddq), after


def jerk_of_drives(
    mass: Rows, torque_rate: object, bandwidth: object, acceleration: object, period: float
) -> NDArray[np.float64]:
    """Return a jerk limit [n] that leaves the drives a part of their torque rate limit.

    A jerk j changes the inertial torque by `M j`. This rate is at most `TORQUE_SHARE` of the drives' limit.

    - `mass`: M, inertia matrix of the arm in the posture where the stream begins [n n].
    - `torque_rate`: torque rate limit of the drives, [n] or one number, N m/s or N/s.
    - `bandwidth`, `acceleration`, `period`: as in `StreamFilter`.

    Raises DefinitionError if the filter needs a larger jerk to brake.
    """
    push = np.broadcast_to(np.asarray(acceleration, float), len(mass))
    pace = float(np.min(TORQUE_SHARE * np.asarray(torque_rate) / (np.abs(mass) @ push)))
    needed = float(np.max(np.asarray(bandwidth)))
    if pace < needed:
        raise DefinitionError(
            "the drives cannot change their torque as fast as this filter changes the acceleration: lower "
            f"`bandwidth` to {pace:.3g} rad/s, or `acceleration` to {pace / needed:.3g} times its value, or set `jerk`"
        )
    return push * np.minimum(min(pace, 2.0 / period), JERK * np.asarray(bandwidth))


class Streamed(AbstractPiecewisePolynomial):
    """The motion that a `StreamFilter` computes from a recorded stream: one cubic per law period, from rest to rest.

    Construct one by `Streamed.through`.
    """

    stream: StreamFilter = piece("the filter")
    behind: Vector = parameter("largest distance of the motion from the host's newest position", "rad or m")

    @property
    def summary(self) -> str:
        """The lag of the motion in words."""
        lag = 1e3 * float(jnp.max(self.stream.lag(0.0)))
        return f"{lag:.3g} ms after a slow stream, at most {float(jnp.max(self.behind)):.3g} rad or m behind"

    @staticmethod
    def through(times: object, positions: object, stream: StreamFilter) -> Streamed:
        """Return the motion for a recorded stream of positions.

        The filter uses a position from the first sample at or after the position's time. The motion starts at rest at
        the first position, and ends at rest at the last one.

        - `times`: times at which the positions arrive [k], s, increasing, the first at 0 or later.
        - `positions`: [k n], rad or m.

        Raises DefinitionError if the shapes do not match, the times are not increasing, a number is not finite, or the
        first position is outside the limits.
        """
        t, rows = float_array("times", times), float_array("positions", positions)
        if t.ndim != 1 or rows.ndim != 2 or len(rows) != len(t) or not len(t):
            raise DefinitionError(
                f"a stream needs one row per time and one column per joint; got shape {list(rows.shape)} for {len(t)} "
                "times"
            )
        if not (np.isfinite(t).all() and t[0] >= 0.0 and (np.diff(t) > 0.0).all()):
            raise DefinitionError(
                f"the times of a stream must be increasing, finite, and 0 or more; got {short_repr(t)}: sort its rows, "
                "and count the time from the start of the motion"
            )
        if not np.isfinite(rows).all():
            row, joint = np.argwhere(~np.isfinite(rows))[0]
            raise DefinitionError(
                f"the positions of a stream must be finite; row {row + 1} is not, for joint {joint + 1}"
            )
        h = float(stream.period)
        if t[-1] > MOST_SAMPLES * h:
            raise DefinitionError(
                f"the stream lasts {t[-1]:g} s, but at most {MOST_SAMPLES * h:g} s are possible at this sample time: "
                "shorten it, or check the unit of its times"
            )
        lower, upper = np.asarray(stream.lower), np.asarray(stream.upper)
        if np.any((rows[0] < lower) | (rows[0] > upper)):
            joint = int(np.argmax((rows[0] < lower) | (rows[0] > upper)))
            raise DefinitionError(
                f"the stream starts at {rows[0, joint]:g} for joint {joint + 1}, outside the joint's limits: the arm "
                "cannot start there"
            )
        ticks = np.ceil(t / h - 1e-6).astype(int)
        span = float(np.ptp(np.clip(rows, lower, upper), axis=0).max())
        count = int(ticks[-1]) + int(np.ceil(_settling(stream, span) / h)) + 1
        newest = np.clip(np.searchsorted(ticks, np.arange(count), side="right") - 1, 0, None)
        fresh = np.isin(np.arange(count), ticks)
        states, before = _filtered(stream, as_array(rows[0]), as_array(rows[newest]), as_array(fresh))
        q, dq, ddq, after = (np.asarray(part) for part in (states.q, states.dq, states.ddq, before))
        moving = np.any(np.abs(q - q[-1]) > AT_REST * span, axis=1)
        count = max(int(ticks[-1]), int(np.count_nonzero(np.logical_or.accumulate(moving[::-1])))) + 1
        q, dq, ddq, jerk = q[:count], dq[:count], ddq[:count], (after - ddq)[:count] / h
        behind = np.abs(rows[newest[:count]] - q).max(axis=0)
        knots = h * np.arange(count + 1)
        return Streamed(
            as_array(knots),
            as_array(np.stack([jerk / 6.0, 0.5 * ddq, dq, q])),
            stream=stream,
            behind=as_array(behind),
        )


@eqx.filter_jit
def _filtered(stream: StreamFilter, start: Vector, targets: Array, fresh: Array) -> tuple[StreamState, Array]:
    """Return the filter's states at all samples, and the acceleration at the end of each period [samples n].

    - `targets`: the host's newest position at each sample [samples n].
    - `fresh`: True for each sample at which that position is new [samples].
    """

    def step(state: StreamState, now: tuple[Vector, Scalar]) -> tuple[StreamState, tuple[StreamState, Vector]]:
        after = stream.step(state, *now)[2]
        return after, (state, after.ddq)

    return jax.lax.scan(step, stream.begin(start), (targets, fresh))[1]


def _settling(stream: StreamFilter, distance: float) -> float:
    """Return a time within which the filter comes to rest from any state at a distance from the goal [s]."""
    v, a, w = (np.asarray(value, float) for value in (stream.velocity, stream.acceleration, stream.bandwidth))
    braking = 2.0 * np.minimum(v, np.sqrt(a * distance)) / (BRAKING * a)
    moving = distance / np.minimum(v, np.maximum(np.sqrt(a * distance), 1e-300))
    last = (np.log(1.0 / AT_REST) + 10.0) / w
    return float(np.max(braking + 2.0 * moving + last)) + float(stream.wait) * float(stream.period)
