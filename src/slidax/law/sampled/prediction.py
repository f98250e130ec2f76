"""Prediction of the arm over the delay, and the inputs of the adaptation.

The delay is the time from a measurement until its torque acts. Commands that have not acted yet are pending.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from slidax.arms.arm import AbstractRobot
from slidax.core.linear_algebra import matvec, solve_symmetric
from slidax.core.types import Memory, Reference, Scalar, State, Vector

from ..adaptation import AbstractAdaptation, Believed, Experience
from ..estimators import Estimate


def commands_kept(delay: float) -> int:
    """Return the number of past commands that a law stores: all pending ones, and at least the last one.

    The torque rate limit needs the last command also without a delay.

    - `delay`: time from a measurement until its torque acts [periods].
    """
    return max(1, math.ceil(delay))


def advance(state: State, acceleration: Vector, duration: Scalar) -> State:
    """Return the state after a duration [s] of constant acceleration [n], rad/s² or m/s²."""
    step = duration * acceleration
    return State(q=state.q + duration * (state.dq + 0.5 * step), dq=state.dq + step)


def free_acceleration(nominal: AbstractRobot, state: State, tau: Vector) -> Vector:
    """Return the nominal arm's acceleration under a torque, [n], rad/s² or m/s²."""
    return solve_symmetric(nominal.mass(state.q), tau - nominal.bias(state.q, state.dq))


def left_unexplained(
    before: AbstractRobot, after: AbstractRobot, changed: Bool[Array, ""], estimate: Estimate, reference: Reference
) -> Vector:
    """Return the disturbance torque for a changed arm model, [n], N m or N, without friction.

    It is `M_old ŵ + (M_new - M_old) q̈_d + b_new - b_old`, with the inertia matrix M and the bias b = C q̇ + G of both
    models. With this disturbance the change of the model does not change the law's torque for the acceleration q̈_d.

    - `before`, `after`: the arm model before and after the change.
    - `changed`: False if only the rotors differ, so that the model of the links is evaluated once.
    - `estimate`: estimated state, and the disturbance ŵ with respect to `before`.
    - `reference`: desired motion, with the acceleration q̈_d.
    """
    assert isinstance(before, Believed)
    assert isinstance(after, Believed)
    q, dq = estimate.state.q, estimate.state.dq
    new, bias = after.mass(q), after.bias(q, dq)
    rotors = eqx.tree_at(lambda arm: arm.rotor, after, before.rotor)
    old, moved = jax.lax.cond(
        changed,
        lambda: (before.mass(q), bias - before.bias(q, dq)),
        lambda: (rotors.mass(q), jnp.zeros_like(bias)),
    )
    return matvec(old, estimate.disturbance) + matvec(new - old, reference.ddq) + moved


class Prediction(NamedTuple):
    """Prediction of the arm over the delay.

    - `state`: predicted state when this sample's torque sets in.
    - `following`: predicted state at the next measurement; None if it depends on this sample's torque.
    - `accelerations`: accelerations of the nominal arm under the pending commands, the oldest first, each [n].
    """

    state: State
    following: State | None
    accelerations: tuple[Vector, ...]


def predict_state(
    estimate: Estimate, acceleration: Callable[[State, int], Vector], delay: float, period: Scalar
) -> Prediction:
    """Return the prediction over the delay, under the pending commands and the estimated disturbance.

    - `estimate`: state and disturbance at the measurement.
    - `acceleration`: function that returns the nominal arm's acceleration [n] for a state and the command of k samples
      ago, from the state and k.
    - `delay`: time from a measurement until its torque acts [periods].
    - `period`: h [s].
    """
    accelerations: list[Vector] = []

    def move(state: State, age: int, duration: Scalar) -> tuple[State, Vector]:
        free = acceleration(state, age)
        return advance(state, free + estimate.disturbance, duration), free

    whole, part = int(delay), delay % 1.0
    now, following = estimate.state, None
    if part > 0:
        now, free = move(now, whole + 1, part * period)
        accelerations.append(free)
    for age in range(whole, 0, -1):
        before = now
        now, free = move(before, age, period)
        accelerations.append(free)
        if age == whole:
            following = now if part == 0 else advance(before, free + estimate.disturbance, (1.0 - part) * period)
    return Prediction(now, following, tuple(accelerations))


def predict_up_to(
    estimate: Estimate, acceleration: Callable[[State, int], Vector], pending: int, delay: Scalar, period: Scalar
) -> Prediction:
    """Return the prediction, as `predict_state`, for a delay that is known only at run time.

    The command of k samples ago acts for `min(max(delay - (k - 1), 0), 1)` periods, which may be 0. `following` of the
    result is the state at the next measurement or when this sample's torque sets in, whichever is earlier.

    - `pending`: largest delay [periods].
    """
    accelerations: list[Vector] = []
    now = following = estimate.state
    for age in range(pending, 0, -1):
        free = acceleration(now, age)
        acts = jnp.clip(delay - float(age - 1), 0.0, 1.0)
        until_next = jnp.clip(1.0 - jnp.maximum(delay - float(age), 0.0), 0.0, acts)
        total = free + estimate.disturbance
        following = advance(following, total, until_next * period)
        now = advance(now, total, acts * period)
        accelerations.append(free)
    return Prediction(now, following, tuple(accelerations))


def reference_ahead(now: Reference, following: Reference, dead_time: float, period: Scalar) -> Reference:
    """Return the desired motion at the end of the dead time, with its mean acceleration over the following period.

    It is a Taylor series, whose error is of the order of the third derivative times the cube of the dead time.

    - `now`, `following`: desired motion at the sample and one period later.
    - `dead_time`: time from the command until its torque acts [periods].
    - `period`: h [s].
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


class AdaptationMemory(eqx.Module):
    """Memory of a sampled-data law's adaptation between two samples.

    - `memory`: memory of the adaptation.
    - `friction`: compensated friction in each pending command, the oldest first, [m n], N m or N.
    - `recovering`: time for which a joint has been on its way back into its envelope (`Recovery`) [s].
    """

    memory: Memory
    friction: Float[Array, "m n"]
    recovering: Scalar

    @classmethod
    def init(cls, adaptation: AbstractAdaptation, state: State, delay: float) -> AdaptationMemory:
        """Return the memory at the start, from the measured state, without friction compensation."""
        friction = jnp.zeros((commands_kept(delay), *state.q.shape), state.q.dtype)
        return cls(memory=adaptation.init(state), friction=friction, recovering=jnp.zeros(()))


def mean_past_torque(torques: Float[Array, "m n"], delay: float, actual: Scalar | None = None) -> Vector:
    """Return the mean torque in the period before a measurement, [n], N m or N.

    For a delay of D whole periods this torque is the command of D + 1 samples ago. For other delays the torque changed
    within the period, and the mean has two terms.

    - `torques`: pending and earlier commands, the oldest first, [m n], N m or N.
    - `delay`: time from a measurement until its torque acts [periods].
    - `actual`: the delay at run time, at most `delay` [periods]; None for `delay`.
    """
    if actual is not None:
        weights = [jnp.maximum(1.0 - jnp.abs(actual - float(age)), 0.0) for age in range(math.ceil(delay) + 1)]
        return jnp.stack(weights) @ jnp.flip(torques, axis=0)[: len(weights)]
    whole, part = int(delay), delay % 1.0
    torque: Vector = torques[-1 - whole]
    return torque if part == 0 else part * torques[-2 - whole] + (1.0 - part) * torque


def experience_of(
    nominal: AbstractRobot,
    measured: State,
    estimate: Estimate,
    tau: Vector,
    period: Scalar,
    missed: Bool[Array, ""],
) -> Experience:
    """Return the input of the adaptation at a sample.

    - `nominal`: the nominal arm.
    - `measured`, `estimate`: measured state, and the estimator's result.
    - `tau`: mean torque in the period before the measurement [n], N m or N.
    - `missed`: True if samples were lost before this one.
    """
    q, dq = estimate.state.q, estimate.state.dq
    return Experience(
        q=measured.q,
        dq=dq,
        tau=tau,
        mass=nominal.mass(q),
        bias=nominal.bias(q, dq),
        period=period,
        missed=missed,
        nominal=nominal,
    )
