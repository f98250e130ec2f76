"""The measurement gate: a sample that the arm cannot have produced counts as a lost sample."""

from __future__ import annotations

import math
from typing import Any

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from slidax.arms.arm import AbstractRobot
from slidax.arms.articulated import Articulated
from slidax.arms.coupled import Coupled
from slidax.core.parameter import parameter
from slidax.core.part import AbstractPart
from slidax.core.types import Matrix, PerJoint, Scalar, State, Vector

LARGEST_POSITION = 1e4
"""rad or m: range of a joint without known position limits."""

FASTEST_JOINT = {"rad": 100.0, "m": 20.0}
"""rad/s and m/s: speed of a joint without a known velocity limit. No robot joint moves faster."""

RUN_UP = {"rad": 2.0 * math.pi, "m": 1.0}
"""rad and m: distance over which a joint reaches its largest speed."""

BEYOND_LIMITS, FASTER_THAN_LIMITS = 1.5, 4.0
"""Range of positions and largest speed, relative to the limits of the arm's description."""

LARGEST_ACCELERATION = 1e4
"""rad/s² and m/s²: acceleration of a joint without known drives."""

SHORTEST = 0.1
"""Periods: two samples that are closer in time count as one time stamp."""

LONGEST_GAP = 100.0
"""Periods: after a longer gap the law starts anew, once a second sample has confirmed the clock."""

FROZEN = 2.0
"""Largest number of repetitions of a sample that are accepted while the arm moves: a sensor may be slower than the
loop."""

CLOCK = 2.0
"""Samples with consistent time stamps that confirm a jump of the clock, or a long gap."""


class GateMemory(eqx.Module):
    """Samples that the gate keeps.

    - `q`, `dq`: the last accepted measurement, [n] each.
    - `suspect_t`, `suspect`: time stamp and measurement of the last rejected sample.
    - `consistent`: rejected samples in a row that are consistent with each other; 0 after an accepted one.
    - `same`: accepted samples in a row that repeat the previous positions to the last bit.
    """

    q: Vector
    dq: Vector
    suspect_t: Scalar
    suspect: State
    consistent: Float[Array, ""]
    same: Float[Array, ""]


class Admission(eqx.Module):
    """Decision of the gate about one sample.

    - `accepted`: True if the law may use the sample.
    - `restarts`: True if the sample is accepted because previous rejected samples confirm it; the law then restarts.
    - `dq`: velocity for a restart [n], rad/s or m/s.
    """

    accepted: Bool[Array, ""]
    restarts: Bool[Array, ""]
    dq: Vector


class MeasurementGate(AbstractPart):
    """Accept a sample only if the arm can have moved there since the last accepted sample.

    q and dq are the last accepted measurement, q' and dq' the new one, T the time between both, and h the period. The
    gate accepts a sample if `0.1 h <= T <= 100 h`, and for every joint

        |q'| <= q_max,   |q' - q| <= speed (T + h) + spread,
        |dq' - dq| <= (2 / patience) speed (T/h + 1) + acceleration (T + h),
        |q' - q - T (dq' + dq)/2| <= T (acceleration (T + 4 h) + 0.02 speed) + 2 spread.

    The last two conditions apply only if the estimator uses velocities. The bounds grow with T, so that samples are
    accepted again after any possible motion of the arm. A rejected sample counts as a lost one: the last torque is
    held, and the law's memory does not change.

    The gate also rejects samples of a frozen sensor: from the third sample in a row that repeats the previous positions
    exactly, while the law predicts that a joint has moved by more than `2 spread + acceleration T h`. A smaller
    predicted motion may be wrong, for a joint that rests against friction or a disturbance.

    A sensor or a clock can jump permanently. After `patience` rejected samples in a row that are consistent with each
    other, the law accepts the next consistent one and restarts. If only the time stamp is implausible, it accepts the
    second sample. The restart takes the measured state and keeps the disturbance estimate, the learnt parameters and
    the sides of the envelope. A sample outside `q_max` is never accepted.
    """

    q_max: PerJoint = parameter("largest magnitude of a measured position", "rad or m", "> 0", default=1e4)
    speed: PerJoint = parameter("largest speed of a joint", "rad/s or m/s", "> 0", default=100.0)
    acceleration: PerJoint = parameter("largest acceleration of a joint", "rad/s² or m/s²", ">= 0", default=1e4)
    spread: PerJoint = parameter("largest error of a measured position", "rad or m", ">= 0", default=0.0)
    patience: Scalar = parameter(
        "rejected samples in a row after which the next consistent one is accepted; exported C requests a stop, too",
        "samples",
        "[2, 1e6]",
        default=5.0,
    )

    @classmethod
    def of_arm(
        cls,
        arm: AbstractRobot,
        *,
        torque: Any = math.inf,
        mass: Matrix | None = None,
        limited: bool = True,
        **parameters: Any,
    ) -> MeasurementGate:
        """Return the gate for an arm, with 1.5 times its position limits and 4 times its velocity limits.

        A disturbance can make a joint faster than its velocity limit. `acceleration` is four times `torque` over the
        joint's inertia, at most 1e4 rad/s² or m/s². A joint without a position limit gets `q_max` = 1e4 rad or m. A
        joint without a velocity limit gets the `speed` after one turn, or one metre, from rest at its `acceleration`,
        at most 100 rad/s or 20 m/s.

        - `arm`: the arm as the law knows it.
        - `torque`: largest torque, one number or [n], N m or N; infinite if it is not known.
        - `mass`: inertia matrix at a working posture [n n]; None if it is not known.
        - `limited`: False for an arm that may move beyond its limits.
        - `parameters`: parameters that replace the computed ones; None replaces nothing.

        Raises DefinitionError if a parameter is out of its range.
        """
        limits = arm.limits if limited and isinstance(arm, Articulated | Coupled) else None
        speed = jnp.asarray([FASTEST_JOINT[unit] for unit in arm.joint_units])
        acceleration = jnp.full(arm.joints, LARGEST_ACCELERATION)
        if mass is not None:
            way = jnp.asarray([RUN_UP[unit] for unit in arm.joint_units])
            acceleration = jnp.minimum(acceleration, 4.0 * jnp.asarray(torque) / jnp.diagonal(mass))
            speed = jnp.minimum(speed, jnp.sqrt(2.0 * way * acceleration))
        q_max = jnp.full(arm.joints, LARGEST_POSITION)
        if limits is not None:
            farthest = BEYOND_LIMITS * jnp.maximum(jnp.abs(limits.lower), jnp.abs(limits.upper))
            q_max = jnp.where(jnp.isfinite(farthest) & (farthest > 0), farthest, q_max)
            speed = jnp.where(jnp.isfinite(limits.velocity), FASTER_THAN_LIMITS * limits.velocity, speed)
        known = {name: value for name, value in parameters.items() if value is not None}
        return cls(**{"q_max": q_max, "speed": speed, "acceleration": acceleration, **known})

    def init(self, t: Scalar, state: State, velocity: bool) -> GateMemory:
        """Return the memory after a first sample at time t [s]; `velocity`: True if the estimator uses velocities."""
        state = _used(state, velocity)
        return GateMemory(
            q=state.q,
            dq=state.dq,
            suspect_t=jnp.asarray(t, state.q.dtype),
            suspect=state,
            consistent=jnp.zeros(()),
            same=jnp.zeros(()),
        )

    def in_range(self, q: Vector) -> Bool[Array, ""]:
        """True if every measured position is within its range."""
        return jnp.all(jnp.abs(q) <= self.q_max)

    def learnable(self, state: State, predicted: State, period: Scalar, velocity: bool) -> Bool[Array, ""]:
        """True if a measurement is near enough to its prediction to learn parameters from it.

        The position must be within `0.4 h speed + spread` of its prediction, a used velocity within
        `(0.04 + 10 h) speed`. A larger difference comes from an outlier, a collision or a disturbance, not from
        the inertia and friction of the joint.

        - `state`, `predicted`: measured state, and the law's prediction of it.
        - `period`: h [s].
        - `velocity`: True if velocities are used.
        """
        near = jnp.all(jnp.abs(state.q - predicted.q) <= 0.4 * period * self.speed + self.spread)
        largest = (0.04 + 10.0 * period) * self.speed
        return near & jnp.all(jnp.abs(state.dq - predicted.dq) <= largest) if velocity else near

    def __call__(
        self,
        t: Scalar,
        state: State,
        last: Scalar,
        predicted: Vector,
        period: Scalar,
        velocity: bool,
        memory: GateMemory,
    ) -> tuple[Admission, GateMemory]:
        """Return the decision about a sample, and the gate's memory after it.

        - `t`, `state`: time stamp [s] and measured state of the sample.
        - `last`: time stamp of the last accepted sample [s].
        - `predicted`: positions that the law predicted for this sample [n].
        - `period`: h [s].
        - `velocity`: True if the estimator uses velocities.
        """
        state = _used(state, velocity)
        elapsed = t - last
        timely = (elapsed >= SHORTEST * period) & (elapsed <= LONGEST_GAP * period)
        accepted = State(memory.q, memory.dq)
        reachable = self._reachable(state, accepted, jnp.where(elapsed > 0, elapsed, period), period, velocity)
        inside = self.in_range(state.q)
        same = jnp.where(jnp.all(state.q == memory.q), memory.same + 1.0, 0.0)
        # The prediction of a joint at rest may be wrong by the motion that the drives cause within the estimator's lag.
        unexplained = 2.0 * self.spread + self.acceleration * jnp.maximum(elapsed, 0.0) * period
        frozen = (same > FROZEN) & jnp.any(jnp.abs(predicted - memory.q) > unexplained)
        plausible = inside & timely & reachable & ~frozen

        since = t - memory.suspect_t
        follows = (memory.consistent > 0) & (since >= SHORTEST * period) & (since <= 2.5 * period)
        follows = follows & self._reachable(state, memory.suspect, since, period, velocity)
        consistent = jnp.where(follows, memory.consistent, 0.0) + 1.0
        confirmed = consistent >= jnp.where(reachable & ~frozen, CLOCK, self.patience + 1.0)
        restarts = inside & ~plausible & confirmed
        takes = plausible | restarts
        slope = (state.q - memory.suspect.q) / jnp.where(since > 0, since, period)
        dq = state.dq if velocity else jnp.clip(slope, -self.speed, self.speed)
        # A sample outside the ranges, or one that is not finite, does not change the memory.
        doubted = inside & ~takes
        after = GateMemory(
            q=jnp.where(takes, state.q, memory.q),
            dq=jnp.where(takes, state.dq, memory.dq) if velocity else memory.dq,
            suspect_t=jnp.where(doubted, t, memory.suspect_t),
            suspect=State(
                q=jnp.where(doubted, state.q, memory.suspect.q),
                dq=jnp.where(doubted, state.dq, memory.suspect.dq) if velocity else memory.suspect.dq,
            ),
            consistent=jnp.where(takes, 0.0, jnp.where(doubted, consistent, memory.consistent)),
            same=jnp.where(plausible, same, jnp.where(restarts, 0.0, memory.same)),
        )
        return Admission(takes, restarts, dq), after

    def _reachable(
        self, state: State, before: State, elapsed: Scalar, period: Scalar, velocity: bool
    ) -> Bool[Array, ""]:
        """True if the arm can move from one measured state to another in the elapsed time."""
        farthest = self.speed * (elapsed + period) + self.spread
        near = jnp.all(jnp.abs(state.q - before.q) <= farthest)
        if not velocity:
            return near
        steps = elapsed / period + 1.0
        change = (2.0 / self.patience) * self.speed * steps + self.acceleration * (elapsed + period)
        # The distance must agree with the mean velocity.
        missing = state.q - before.q - 0.5 * elapsed * (state.dq + before.dq)
        slack = self.acceleration * (elapsed + 4.0 * period) + 0.02 * self.speed
        fits = jnp.all(jnp.abs(missing) <= elapsed * slack + 2.0 * self.spread)
        return near & fits & jnp.all(jnp.abs(state.dq - before.dq) <= change)


def _used(state: State, velocity: bool) -> State:
    """The measured state, with zeros for velocities that the estimator does not use."""
    return state if velocity else State(q=state.q, dq=jnp.zeros_like(state.q))
