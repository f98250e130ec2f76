"""Adaptation state of a sampled-data law, and the input of its adaptation at each sample."""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from slidax.adaptation import AbstractAdaptation, Experience
from slidax.estimators import Estimate
from slidax.parts import Memory, Scalar, State, Vector
from slidax.robots import AbstractRobot

from .prediction import commands_kept


class Adapted(eqx.Module):
    """Adaptation state between two samples.

    - `memory`: of the adaptation.
    - `friction`: friction compensation in each pending command, the oldest first, [m n].
    - `recovering`: duration of the current way back into the envelope [s].
    """

    memory: Memory
    friction: Float[Array, "m n"]
    recovering: Scalar

    @classmethod
    def init(cls, adaptation: AbstractAdaptation, state: State, delay: float) -> Adapted:
        """Return the initial state, without friction compensation."""
        friction = jnp.zeros((commands_kept(delay), *state.q.shape), state.q.dtype)
        return cls(memory=adaptation.init(state), friction=friction, recovering=jnp.zeros(()))


def mean_past_torque(torques: Float[Array, "m n"], delay: float) -> Vector:
    """Return the mean torque in the period before a measurement, [n], N m or N.

    With a whole number D of periods of delay it is the command of D + 1 samples ago. Else the torque changed within the
    period, and the mean has two terms.

    - `torques`: pending commands and those before, the oldest first.
    - `delay`: age of a measurement when its torque sets in [periods].
    """
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

    - `tau`: torque that acted in the period before.
    - `missed`: True if samples were lost before.
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
    )
