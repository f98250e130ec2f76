"""What a law at the arm's own rate keeps of its adaptation, and what it tells it at each sample."""

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
    """What is kept of an adaptation between two samples.

    - `memory`: of the adaptation.
    - `friction`: the part of each command under way that compensates friction, the oldest first, [m n].
    - `recovering`: time for which a joint has been on its way back into its envelope [s].
    """

    memory: Memory
    friction: Float[Array, "m n"]
    recovering: Scalar

    @classmethod
    def init(cls, adaptation: AbstractAdaptation, state: State, delay: float) -> Adapted:
        """Nothing learnt, and no friction compensated.

        - `adaptation`: what learns.
        - `state`: measured positions and velocities.
        - `delay`: age of a measurement when its torque sets in [periods].
        """
        friction = jnp.zeros((commands_kept(delay), *state.q.shape), state.q.dtype)
        return cls(memory=adaptation.init(state), friction=friction, recovering=jnp.zeros(()))


def acted(torques: Float[Array, "m n"], delay: float) -> Vector:
    """The torque that acted in the period before a measurement, [n], N m or N.

    With a whole number D of periods of delay it is the command of D + 1 samples ago. Else it changed within the period,
    and is their mean over time.

    - `torques`: commands under way and those before, the oldest first.
    - `delay`: age of a measurement when its torque sets in [periods].
    """
    whole, part = int(delay), delay % 1.0
    torque: Vector = torques[-1 - whole]
    return torque if part == 0 else part * torques[-2 - whole] + (1.0 - part) * torque


def experienced(
    nominal: AbstractRobot,
    measured: State,
    estimate: Estimate,
    tau: Vector,
    period: Scalar,
    missed: Bool[Array, ""],
) -> Experience:
    """What a sample shows of the arm.

    - `nominal`: the robot as the law knows it.
    - `measured`: positions and velocities.
    - `estimate`: what they were estimated to be.
    - `tau`: the torque that acted in the period before.
    - `period`: h [s].
    - `missed`: whether samples were lost before.
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
