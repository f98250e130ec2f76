"""The calm step of a law: it changes the torque as little as possible while the error is well inside its envelope.

The led error is `y = e + c ė` with the lead time `c = H - h/2`, the period h and the horizon H of the law's plan.
"""

from __future__ import annotations

from dataclasses import replace
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp

from slidax.arms.arm import AbstractRobot
from slidax.core.errors import DefinitionError, require_joints
from slidax.core.linear_algebra import matvec
from slidax.core.parameter import parameter, piece
from slidax.core.part import AbstractPart
from slidax.core.types import Envelope, Memory, PerJoint, Reference, Scalar, State, Vector

from .error_transformations import AbstractTransformation
from .implicit_steps import AbstractSurfaceStep
from .steps import AbstractStep, Decision, StepInput

WAIT = 0.1
"""s: time for which a joint must be well inside its envelope before its steps are calm."""

ERROR_SHARE, LED_SHARE = 0.2, 0.3
"""A joint is well inside if error and led error are below these shares of the narrower side of their envelopes."""

SUDDEN, USUAL_TIME = 6.0, 1.0
"""Change of the estimated disturbance that ends calm steps, over its recent mean; and the mean's time constant, s."""

DAMPING, TURN = 0.7, 0.71
"""Real and imaginary part of a pair of poles, over the bandwidth; the third pole is real, at the bandwidth."""

GROWTH, DECAY, STEEPEST = 30.0, 0.5, 3.0
"""Growth rate of the bandwidth at an error of twice its threshold `near` [1/s], its decay rate below it [1/s], and the
largest relative excess of the error over the threshold that counts."""


class Calm(AbstractPart):
    """Settings of the calm step.

    A joint's bandwidth is `ω0 (M0_ii)^(-1/3)` with its nominal inertia M0_ii, and larger while its error is large, but
    at most `fastest`.
    """

    title = "Smallest torque changes while the error is well inside its envelope."

    bandwidth: PerJoint = parameter(
        "ω0, bandwidth of a joint with an inertia of 1 kg m² or 1 kg", "rad/s", "> 0", default=80.0
    )
    fastest: PerJoint = parameter("largest bandwidth", "rad/s", "> 0", default=140.0)
    near: PerJoint = parameter(
        "share of the envelope's narrower side, beyond which an error raises the bandwidth", "", "(0, 1)", default=0.02
    )
    room: PerJoint = parameter("largest share of the led envelope at which a step aims", "", "(0, 1)", default=0.8)


class CalmMemory(eqx.Module):
    """Memory of a calm step, all [n] except `plan`.

    - `plan`: memory of the law's own step.
    - `acceleration`: acceleration of the last step minus the reference's, rad/s² or m/s².
    - `disturbance`: ŵ, estimated disturbance at the last step, rad/s² or m/s².
    - `inside`: time for which the joint has been well inside its envelope, s; at most twice `WAIT`.
    - `pace`: ratio of the bandwidth to its value for small errors.
    - `usual`: recent mean of the change of ŵ from one sample to the next, rad/s² or m/s².
    """

    plan: Memory
    acceleration: Vector
    disturbance: Vector
    inside: Vector
    pace: Vector
    usual: Vector


class CalmStep(AbstractStep):
    """A step that changes the torque as little as it can while a joint is well inside its envelope.

    All accelerations are relative to the reference's. e and v are the errors of position and velocity at the time when
    the torque sets in. a⁻ is the last step's acceleration, and Δw the change of the estimated disturbance ŵ since then.
    ρ_a is the radius of the envelope of the led error y at the end of the plan's horizon H, with the sides b and b̄.

    1. `z = a⁻ + Δw`: the acceleration if the torque does not change;
    2. `a = z - K1 e - K2 v - K3 z`: with `e⁺ = e + h v + h² a/2`, `v⁺ = v + h a` the loop has the poles `exp(-d)` and
       `exp(d (-0.7 ± 0.71 i))`, `d = ω h`;
    3. a leads to the normalised led error `ψ = (H (H a + v) + y)/ρ_a`. ψ is clipped to `[room b, room b̄]`, and
       `a = ((ρ_a ψ - y)/H - v)/H`.

    In one period y moves to `(1 - h/H) y + (h/H) ρ_a ψ`, as in the law's own step (docs/sampled-data.md). The law's own
    step is used for a joint while `|e|` exceeds 0.2, or `|y|` 0.3, of its envelope's narrower side, and 0.1 s longer.
    It is used for all joints during a recovery (`Recovery`), after lost samples, after a limit of the drives has acted,
    and after a sudden disturbance: a change of ŵ by more than six times the mean change of the last second. It is also
    used while a learnt model of the arm is not in full use.

    The bandwidth `ω = ω0 (M0_ii)^(-1/3)` minimises the sum of squared error and torque change for every inertia. While
    `|e|` exceeds the share `near` of the narrower side, ω grows by up to `exp(90 h)` in each period. Otherwise it falls
    back by `exp(-0.5 h)`.

    Signals: those of the law's own step; `calm` [n], 1 where the step is calm; and `bandwidth` [n], ω.
    """

    plan: AbstractSurfaceStep = piece("the law's own step")
    calm: Calm = piece("settings: bandwidth, and share of the envelope")
    plans: ClassVar[bool] = True

    def __check_init__(self) -> None:
        require_joints(self.calm, self.plan.robot.joints, type(self.plan.robot).__name__)
        still = jnp.zeros(self.plan.robot.joints)
        memory = self.transformation.init(jnp.zeros(()), still)
        if self.transformation.envelope(jnp.zeros(()), memory) is None:
            raise DefinitionError(
                "a calm step stays inside an envelope, and this law has none: leave `calm` out, or choose a scheme "
                "with an envelope, such as `cftsmppc`"
            )

    @property
    def robot(self) -> AbstractRobot:
        return self.plan.robot

    @property
    def transformation(self) -> AbstractTransformation:
        """The law's own error transformation."""
        return self.plan.transformation

    def init(self, t: Scalar, state: State, reference: Reference, period: Scalar, horizon: Scalar | None) -> CalmMemory:
        zero = jnp.zeros_like(state.q)
        plan = self.plan.init(t, state, reference, period, horizon)
        return CalmMemory(plan=plan, acceleration=zero, disturbance=zero, inside=zero, pace=zero + 1.0, usual=zero)

    def restarted(self, t: Scalar, memory: CalmMemory) -> CalmMemory:
        return replace(memory, plan=self.plan.restarted(t, memory.plan), inside=jnp.zeros_like(memory.inside))

    def recovers(self, t: Scalar, memory: CalmMemory) -> Memory:
        return self.plan.recovers(t, memory.plan)

    def envelope(self, t: Scalar, memory: CalmMemory) -> Envelope | None:
        return self.plan.envelope(t, memory.plan)

    def __call__(self, moment: StepInput, memory: CalmMemory) -> Decision:
        h, horizon, desired = moment.period, moment.horizon, moment.reference
        assert horizon is not None
        # s was not planned where the last step was calm.
        planned = moment.planned & ~jnp.any(memory.inside >= WAIT)
        own = self.plan(replace(moment, planned=planned), memory.plan)

        e, v = moment.state.q - desired.q, moment.state.dq - desired.dq
        y = e + (horizon - 0.5 * h) * v
        change = moment.disturbance - memory.disturbance
        usual = memory.usual + (h / USUAL_TIME) * (jnp.abs(change) - memory.usual)
        sudden = jnp.any(jnp.abs(change) > SUDDEN * usual)
        inside = jnp.where(sudden, 0.0, self._inside(moment, e, y, memory))
        calm = inside >= WAIT
        bandwidth, pace = self._bandwidth(moment, e, memory)
        z = memory.acceleration + change
        k1, k2, k3 = gains(bandwidth, h)
        acceleration = self._held_inside(moment, z - k1 * e - k2 * v - k3 * z, y, v, memory)
        acceleration = jnp.where(calm, acceleration, own.acceleration - desired.ddq)
        total = desired.ddq + acceleration

        def kept(plan: Memory) -> CalmMemory:
            return CalmMemory(plan, acceleration, moment.disturbance, inside, jnp.where(calm, pace, 1.0), usual)

        return replace(
            own,
            tau=matvec(moment.mass, total) + moment.bias,
            acceleration=total,
            memory=kept(own.memory),
            signals={**own.signals, "calm": calm.astype(float), "bandwidth": bandwidth},
            limited=None if own.limited is None else kept(own.limited),
        )

    def _inside(self, moment: StepInput, e: Vector, y: Vector, memory: CalmMemory) -> Vector:
        """The time for which each joint has been well inside [n], s."""
        horizon = moment.horizon
        assert horizon is not None
        sides = memory.plan.sides
        frame = self.transformation.frame(moment.t, horizon - 0.5 * moment.period, horizon, sides)
        assert frame.sides is not None
        narrower = jnp.minimum(-frame.sides.lower, frame.sides.upper)
        within = jnp.abs(e) < ERROR_SHARE * self._radius(moment, memory)
        within = within & (jnp.abs(y) < LED_SHARE * narrower * frame.now)
        within = within & moment.planned & moment.settled & ~self.plan.recovers(moment.t, memory.plan)
        return jnp.where(within, jnp.minimum(memory.inside + moment.period, 2.0 * WAIT), 0.0)

    def _radius(self, moment: StepInput, memory: CalmMemory) -> Vector:
        """The narrower side of each joint's envelope [n], rad or m."""
        envelope = self.envelope(moment.t, memory)
        assert envelope is not None
        return jnp.minimum(-envelope.lower, envelope.upper)

    def _bandwidth(self, moment: StepInput, e: Vector, memory: CalmMemory) -> tuple[Vector, Vector]:
        """The bandwidth ω of each joint [n], rad/s, and its ratio to the least one."""
        h, calm = moment.period, self.calm
        least = jnp.minimum(calm.bandwidth * jnp.diagonal(moment.mass) ** (-1.0 / 3.0), calm.fastest)
        excess = jnp.abs(e) / (calm.near * self._radius(moment, memory)) - 1.0
        change = jnp.where(excess > 0.0, GROWTH * jnp.minimum(excess, STEEPEST), -DECAY)
        pace = jnp.clip(memory.pace * jnp.exp(h * change), 1.0, calm.fastest / least)
        return pace * least, pace

    def _held_inside(self, moment: StepInput, a: Vector, y: Vector, v: Vector, memory: CalmMemory) -> Vector:
        """The acceleration, limited so that ψ stays in `[room b, room b̄]`, [n], rad/s² or m/s²."""
        horizon, room = moment.horizon, self.calm.room
        assert horizon is not None
        frame = self.transformation.frame(moment.t, horizon - 0.5 * moment.period, horizon, memory.plan.sides)
        assert frame.sides is not None
        place = (horizon * (horizon * a + v) + y) / frame.ahead
        place = jnp.clip(place, room * frame.sides.lower, room * frame.sides.upper)
        return ((frame.ahead * place - y) / horizon - v) / horizon


def gains(bandwidth: Vector, h: Scalar) -> tuple[Vector, Vector, Vector]:
    """Return the gains K1 [1/s²], K2 [1/s] and K3 of `a = z - K1 e - K2 v - K3 z`, [n] each, as in `CalmStep`.

    a is the commanded acceleration, z the one of an unchanged torque, e the tracking error and v its rate. The gains
    place the poles of the loop with the state (e, v, z) where `CalmStep` states them (Ackermann's formula).

    - `bandwidth`: ω of each joint [n], rad/s.
    - `h`: period [s].
    """
    d = bandwidth * h
    real = jnp.exp(-DAMPING * d) * jnp.cos(TURN * d)
    # Coefficients of the polynomial in `pole - 1`: of the real pole, of the pair, and of all three.
    first = -jnp.expm1(-d)
    linear, constant = 2.0 * (1.0 - real), 1.0 - 2.0 * real + jnp.exp(-2.0 * DAMPING * d)
    a0, a1, a2 = first * constant, constant + first * linear, first + linear
    return a0 / (h * h), (a1 - 1.5 * a0) / h, a0 - a1 + a2
