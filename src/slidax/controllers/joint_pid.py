"""A PID controller at each joint."""

from __future__ import annotations

import jax.numpy as jnp

from slidax._types import Command, Reference
from slidax.parts import Memory, PerJoint, Scalar, State, Vector, parameter

from .model_based import AbstractModelBased

STABLE = "so that the joint is stable"


class JointPID(AbstractModelBased):
    """`τ = -Kp e - Kd ė - Ki z + g G0(q)`, `ż = e`, `z(0) = 0`: the usual controller of drives, for each joint alone.

    The integral of a joint stops while `|τ|` is at or above `limit` and the error would raise it further
    (conditional integration), so that it does not wind up. In sampled-data form all integrals stop while any
    limit withholds torque. `g` is 0 unless the weight is to be compensated; the model has no other use.

    Source: Åström and Hägglund, Advanced PID Control, 2006, section 3.5 (windup).

    Signals: `e` [n], `de` [n], `z` [n].
    """

    kp: PerJoint = parameter("diagonal of Kp", "N m/rad or N/m", "> 0", STABLE, default=400.0)
    ki: PerJoint = parameter("diagonal of Ki", "N m/(rad s) or N/(m s)", ">= 0", STABLE, default=800.0)
    kd: PerJoint = parameter("diagonal of Kd", "N m s/rad or N s/m", "> 0", STABLE, default=100.0)
    gravity: Scalar = parameter("g, which share of the nominal arm's weight is compensated", "", "[0, 1]", default=0.0)
    limit: PerJoint | None = parameter(
        "torque at which the integral stops", "N m or N", "> 0", default=None, source="the drives' limit, if known"
    )

    def init(self, t: Scalar, state: State, reference: Reference) -> Vector:
        return jnp.zeros_like(state.q - reference.q)

    def __call__(
        self, t: Scalar, state: State, reference_now: Reference, reference_next: Reference, memory: Memory
    ) -> Command:
        e, de = state.q - reference_now.q, state.dq - reference_now.dq
        tau = self.gravity * self.nominal.gravity(state.q) - self.kp * e - self.kd * de - self.ki * memory
        rate = e
        if self.limit is not None:
            rate = jnp.where((jnp.abs(tau) >= self.limit) & (tau * e < 0.0), 0.0, e)
        return Command(tau=tau, memory=memory, signals={"e": e, "de": de, "z": memory}, rate=rate)
