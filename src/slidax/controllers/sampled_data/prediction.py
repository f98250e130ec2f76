"""From what was measured to what will be when a torque sets in."""

from __future__ import annotations

import math

from jaxtyping import Array, Float

from slidax._types import Reference
from slidax.estimators import Estimate
from slidax.numerics import solve_symmetric
from slidax.parts import Scalar, State, Vector
from slidax.robots import AbstractRobot


def commands_kept(delay: float) -> int:
    """How many commands are kept: those under way, and at least the last, which the rate limit counts from.

    - `delay`: age of a measurement when its torque sets in [periods].
    """
    return max(1, math.ceil(delay))


def moved_on(state: State, acceleration: Vector, duration: Scalar) -> State:
    """The state after a time under a constant acceleration.

    - `state`: before.
    - `acceleration`: [n], rad/s² or m/s².
    - `duration`: [s].
    """
    step = duration * acceleration
    return State(q=state.q + duration * (state.dq + 0.5 * step), dq=state.dq + step)


def free_acceleration(nominal: AbstractRobot, state: State, tau: Vector) -> Vector:
    """The acceleration of the nominal arm, [n], rad/s² or m/s².

    - `nominal`: the robot as the law knows it.
    - `state`: positions and velocities.
    - `tau`: torque [n], N m or N.
    """
    return solve_symmetric(nominal.mass(state.q), tau - nominal.bias(state.q, state.dq))


def predicted(
    nominal: AbstractRobot, estimate: Estimate, torques: Float[Array, "m n"], delay: float, period: Scalar
) -> tuple[State, State | None]:
    """The state when this sample's torque sets in, and the one that will be measured next if that is before.

    The nominal arm with the estimated push, under one torque after the other that is under way.

    - `nominal`: the robot as the law knows it.
    - `estimate`: the state that was measured, and the push.
    - `torques`: commands under way, the oldest first.
    - `delay`: age of a measurement when its torque sets in [periods].
    - `period`: [s].
    """

    def move(state: State, tau: Vector, duration: Scalar) -> State:
        return moved_on(state, free_acceleration(nominal, state, tau) + estimate.push, duration)

    whole, part = int(delay), delay % 1.0
    now, following = estimate.state, None
    if part > 0:
        now = move(now, torques[-1 - whole], part * period)
    if whole > 0:
        following = move(now, torques[-whole], (1.0 - part) * period)
        now = following if part == 0 else move(now, torques[-whole], period)
    for i in range(whole - 1, 0, -1):
        now = move(now, torques[-i], period)
    return now, following


def reference_ahead(now: Reference, following: Reference, dead_time: float, period: Scalar) -> Reference:
    """What the joints should do a dead time after a sample, and the mean acceleration over the period from there.

    By Taylor's series: off by the third derivative times the cube of the dead time.

    - `now`, `following`: what the joints should do at the sample and one period later.
    - `dead_time`: [periods].
    - `period`: [s].
    """
    mean = (following.dq - now.dq) / period
    if dead_time == 0:
        return Reference(q=now.q, dq=now.dq, ddq=mean)
    dead = dead_time * period
    jerk = (following.ddq - now.ddq) / period
    return Reference(
        q=now.q + dead * (now.dq + 0.5 * dead * now.ddq),
        dq=now.dq + dead * (now.ddq + 0.5 * dead * jerk),
        ddq=mean + dead * jerk,
    )
