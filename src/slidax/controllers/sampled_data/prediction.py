"""Prediction from the last measurement to the time when a torque sets in."""

from __future__ import annotations

import math

from jaxtyping import Array, Float

from slidax._types import Reference
from slidax.estimators import Estimate
from slidax.numerics import solve_symmetric
from slidax.parts import Scalar, State, Vector
from slidax.robots import AbstractRobot


def commands_kept(delay: float) -> int:
    """Number of commands in the memory: all pending ones, and at least the last, for the rate limit.

    - `delay`: age of a measurement when its torque sets in [periods].
    """
    return max(1, math.ceil(delay))


def advance(state: State, acceleration: Vector, duration: Scalar) -> State:
    """Return the state after a duration [s] of constant acceleration [n], rad/s² or m/s²."""
    step = duration * acceleration
    return State(q=state.q + duration * (state.dq + 0.5 * step), dq=state.dq + step)


def free_acceleration(nominal: AbstractRobot, state: State, tau: Vector) -> Vector:
    """Return the nominal arm's acceleration under a torque, [n], rad/s² or m/s²."""
    return solve_symmetric(nominal.mass(state.q), tau - nominal.bias(state.q, state.dq))


def predict_state(
    nominal: AbstractRobot, estimate: Estimate, torques: Float[Array, "m n"], delay: float, period: Scalar
) -> tuple[State, State | None]:
    """Return the state when this sample's torque sets in, and the next measured state if that is earlier.

    The nominal arm moves with the estimated disturbance under each pending torque in turn.

    - `torques`: pending commands, the oldest first.
    - `delay`: age of a measurement when its torque sets in [periods].
    - `period`: [s].
    """

    def move(state: State, tau: Vector, duration: Scalar) -> State:
        return advance(state, free_acceleration(nominal, state, tau) + estimate.push, duration)

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
    """Return the desired motion a dead time after a sample, with the mean acceleration over the following period.

    Taylor series with an error of the order of the third derivative times the cube of the dead time.

    - `now`, `following`: desired motion at the sample and one period later.
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
