"""PID, PD with gravity compensation, and computed torque.

e is the tracking error `q - q_d`. M0, C0 and G0 are the nominal arm's inertia matrix, Coriolis matrix and gravity
torque.
"""

from __future__ import annotations

import jax.numpy as jnp

from slidax.core.errors import DefinitionError, is_traced
from slidax.core.linear_algebra import matvec
from slidax.core.parameter import parameter
from slidax.core.types import Command, Memory, PerJoint, Reference, Scalar, State, Vector

from .controllers import AbstractModelBased

STABLE = "so that the joint is stable"


class JointPID(AbstractModelBased):
    """`τ = -Kp e - Kd ė - Ki z + g G0(q)`, `ż = e`, `z(0) = 0`: the usual controller of drives, for each joint alone.

    The integral of a joint stops while `|τ|` is at or above `limit` and the error would raise it further
    (conditional integration), so that it does not wind up. In sampled-data form all integrals stop while any
    limit withholds torque. `g` is the compensated share of the nominal arm's weight. The printed law uses nothing else
    of the arm's model.

    Source: Åström and Hägglund, Advanced PID Control, 2006, section 3.5 (windup).

    Signals: `e` [n], `de` [n], `z` [n].
    """

    kp: PerJoint = parameter("diagonal of Kp", "N m/rad or N/m", "> 0", STABLE, default=400.0)
    ki: PerJoint = parameter("diagonal of Ki", "N m/(rad s) or N/(m s)", ">= 0", STABLE, default=800.0)
    kd: PerJoint = parameter("diagonal of Kd", "N m s/rad or N s/m", "> 0", STABLE, default=100.0)
    gravity: Scalar = parameter("g, compensated share of the nominal arm's weight", "", "[0, 1]", default=0.0)
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


STABLE_POSTURE = "so that the posture is stable (Takegaki and Arimoto, 1981)"


class GravityCompensatedPD(AbstractModelBased):
    """`τ = -Kp e - Kd ė + G0(q)`: regulates an arm to a posture; a moving reference leaves a tracking lag.

    Only the gravity of the nominal robot is used.
    Source: Takegaki and Arimoto, 1981; Siciliano et al., Robotics: Modelling, Planning and Control, 2009, sec. 8.5.1.

    Signals: `e` [n], `de` [n].
    """

    kp: PerJoint = parameter("diagonal of Kp", "N m/rad or N/m", "> 0", STABLE_POSTURE, default=400.0)
    kd: PerJoint = parameter("diagonal of Kd", "N m s/rad or N s/m", "> 0", STABLE_POSTURE, default=100.0)

    def __call__(
        self, t: Scalar, state: State, reference_now: Reference, reference_next: Reference, memory: Memory
    ) -> Command:
        e, de = state.q - reference_now.q, state.dq - reference_now.dq
        tau = self.nominal.gravity(state.q) - self.kp * e - self.kd * de
        return Command(tau=tau, memory=memory, signals={"e": e, "de": de})


class ComputedTorque(AbstractModelBased):
    """`τ = M0 (q̈_d - Kp e - Kd ė) + C0 q̇ + G0`: with the exact model each joint is an independent linear oscillator.

    Source: Siciliano et al., Robotics: Modelling, Planning and Control, 2009, section 8.5.2 (inverse dynamics control).

    A `horizon` H replaces both gains by `Kp = 1/H²`, `Kd = 2/H`. In sampled-data form with the period h it is
    `Kd = (H - h/2)/H² + 1/H`, for which the sampled error has the double eigenvalue `1 - h/H` (docs/sampled-data.md).

    Signals: `e` [n], `de` [n].
    """

    kp: PerJoint = parameter("diagonal of Kp", "1/s²", "> 0", "so that the error oscillator is stable", default=100.0)
    kd: PerJoint = parameter(
        "diagonal of Kd; `2 √kp` damps critically", "1/s", "> 0", "so that the error oscillator is stable", default=20.0
    )
    horizon: Scalar | None = parameter(
        "H, which replaces `kp` and `kd` by critically damped gains; None to keep them", "s", "> 0", default=None
    )

    def gains(self, period: Scalar | float = 0.0) -> tuple[PerJoint, PerJoint]:
        """Return the diagonals of Kp [1/s²] and Kd [1/s] for a sampling period [s]; 0 for continuous time."""
        if self.horizon is None:
            return self.kp, self.kd
        rate = 1.0 / self.horizon
        return rate * rate, (self.horizon - 0.5 * period) * rate * rate + rate

    def at_period(self, period: Scalar) -> ComputedTorque:
        if not is_traced((self.horizon, period)) and self.horizon is not None and self.horizon < period:
            raise DefinitionError(
                f"`ComputedTorque.horizon` must be at least the period of {float(period):g} s in sampled-data form; "
                f"got {float(self.horizon):g} s"
            )
        kp, kd = self.gains(period)
        return ComputedTorque(self.nominal, kp=kp, kd=kd)

    def __call__(
        self, t: Scalar, state: State, reference_now: Reference, reference_next: Reference, memory: Memory
    ) -> Command:
        e, de = state.q - reference_now.q, state.dq - reference_now.dq
        kp, kd = self.gains()
        wanted = reference_now.ddq - kp * e - kd * de
        tau = matvec(self.nominal.mass(state.q), wanted) + self.nominal.bias(state.q, state.dq)
        return Command(tau=tau, memory=memory, signals={"e": e, "de": de})
