"""Base class of discrete-time steps, and recovery: a new envelope around an error that has left the prescribed one."""

from __future__ import annotations

from abc import abstractmethod
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool

from slidax.arms.arm import AbstractRobot
from slidax.core.parameter import parameter
from slidax.core.part import AbstractPart
from slidax.core.types import Envelope, Matrix, Memory, Reference, Scalar, State, Vector
from slidax.plant.actuators import TorqueLimits

from .error_transformations import EnvelopeFrame, Sides


class StepInput(eqx.Module):
    """Input of a step, for the time t when this sample's torque sets in.

    - `t`: this time [s].
    - `state`: predicted positions and velocities.
    - `reference`: desired motion, with its mean acceleration over the following period.
    - `mass`: inertia matrix M0 of `robot` [n n].
    - `bias`: C0 q̇ + G0 of `robot` [n], N m or N.
    - `robot`: the arm as the law knows it, with the estimated parameters.
    - `limits`: limits of torque and torque rate.
    - `period`: h [s].
    - `horizon`: H [s]; None for a law without a plan.
    - `planned`: True if the last sample was one period ago, and no limit changed its torque.
    - `expected`: the velocity that the last sample planned for the time t [n], rad/s or m/s.
    - `disturbance`: ŵ, the acceleration that the model does not explain [n], rad/s² or m/s².
    - `settled`: True while the law uses a learnt arm model with its full weight, and for a law that learns none.
    """

    t: Scalar
    state: State
    reference: Reference
    mass: Matrix
    bias: Vector
    robot: AbstractRobot
    limits: TorqueLimits
    period: Scalar
    horizon: Scalar | None
    planned: Bool[Array, ""]
    expected: Vector
    disturbance: Vector
    settled: Bool[Array, ""]


class Decision(eqx.Module):
    """Result of a step, before the disturbance compensation and the torque limits.

    - `tau`: torque [n], N m or N.
    - `acceleration`: acceleration of the nominal arm under this torque [n], rad/s² or m/s².
    - `memory`: memory after this sample.
    - `signals`: inner quantities by name.
    - `cover`: largest norm of the disturbance torque to compensate, N m; None if only the torque limits bound it.
    - `limited`: memory in place of `memory` if a limit withholds torque, with stopped integrals; None for `memory`.
    """

    tau: Vector
    acceleration: Vector
    memory: Memory
    signals: dict[str, Array]
    cover: Scalar | None = None
    limited: Memory = None


class AbstractStep(AbstractPart):
    """A law in discrete time: it computes a torque from the state predicted for the time when the torque sets in."""

    plans: ClassVar[bool]
    """True if the step plans over a horizon."""

    @property
    @abstractmethod
    def robot(self) -> AbstractRobot:
        """The robot as the law knows it."""

    @abstractmethod
    def init(self, t: Scalar, state: State, reference: Reference, period: Scalar, horizon: Scalar | None) -> Memory:
        """Return the memory at the start.

        - `t`: time at the start [s].
        - `state`: measured positions and velocities.
        - `reference`: desired motion of the joints at that time.
        - `period`, `horizon`: h and H [s]; H is None for a law without a plan.
        """

    def restarted(self, t: Scalar, memory: Memory) -> Memory:
        """Return the memory after the gate restarts the law at time t [s] (`MeasurementGate`); by default unchanged."""
        return memory

    def recovers(self, t: Scalar, memory: Memory) -> Bool[Array, ""]:
        """True while the new envelope of a `Recovery` is in force for at least one joint at time t [s]."""
        return jnp.zeros((), bool)

    @abstractmethod
    def __call__(self, moment: StepInput, memory: Memory) -> Decision:
        """Return the torque, the resulting acceleration and the memory.

        - `moment`: predicted state, reference and model at the time when the torque sets in.
        - `memory`: from `init` or the last sample.
        """

    @abstractmethod
    def envelope(self, t: Scalar, memory: Memory) -> Envelope | None:
        """Return the bounds that the error must keep at time t [s]; None for a law without an envelope."""


TINY = 1e-30
"""Addend under a square root, so that its derivative is finite without torque limits."""

LOOSE = 4.0
"""A new envelope replaces an earlier one that is wider by this factor."""


class EnvelopeReset(eqx.Module):
    """New envelopes around errors that have left the prescribed ones; all [n].

    A new envelope is wider than the narrower side of the prescribed one by the excess X(t), which falls to 0.

    - `until`: time at which the new envelope ends [s].
    - `span`: its duration [s].
    - `excess`: excess at the start of the new envelope, rad or m.
    - `outside`: True if the joint was outside at the last sample.
    """

    until: Vector
    span: Vector
    excess: Vector
    outside: Bool[Array, " n"]

    def excess_rate_curvature(self, t: Scalar) -> tuple[Vector, Vector, Vector]:
        """Return `X = excess ((until - t)/span)³` and its two time derivatives, [n]; 0 from `until` on."""
        left = jnp.clip((self.until - t) / self.span, 0.0, 1.0)
        per_second = 1.0 / self.span
        x = self.excess * left
        return x * left * left, -3.0 * x * left * per_second, 6.0 * x * per_second * per_second


class Recovery(AbstractPart):
    """The policy `recover`: a joint that has left its envelope gets the new one `|e| < ϑ ρ(t) + X(t)` for a while.

    ϑ ρ(t) is the narrower side of the prescribed envelope. The new envelope starts with the radius `R0/(1 - 3 c/S)`,
    `R0 = room (|e| + c |ė| + ė²/(2a))`. It leaves the distance to brake with the acceleration a, which the torque
    limits allow; c is the lead time `H - h/2`. X is a cubic that falls to 0 in the time
    `S = max(deadline, 12 c, sqrt(6 R0/(share a)))`; its curvature is about `share a` at most. Then the prescribed
    envelope is in force again. X is computed anew once the new envelope is four times wider than necessary.

    A single outlier does not set X: the first sample outside uses its own X, and X stays only if the next sample is
    outside, too.
    """

    title = "Recovery outside the envelope: a new envelope around the error narrows into the prescribed one."

    deadline: Scalar = parameter("least time for the way back", "s", "> 0", default=0.3)
    room: Scalar = parameter(
        "radius of a new envelope over the distance that the joint needs to brake",
        "",
        "> 1",
        "so that there is room to brake",
        default=1.6,
    )
    share: Scalar = parameter(
        "share of the acceleration within the torque limits that a new envelope may need", "", "(0, 1)", default=0.25
    )

    def init(self, t: Scalar, joints: int) -> EnvelopeReset:
        """Return the memory at the start time t [s], without new envelopes."""
        zero = jnp.zeros(joints)
        return EnvelopeReset(until=zero + t, span=zero + 1.0, excess=zero, outside=jnp.zeros(joints, bool))

    def reset_envelope(
        self, t: Scalar, e: Vector, de: Vector, drawn: Envelope, slowness: Vector, lead_time: Scalar, now: EnvelopeReset
    ) -> tuple[EnvelopeReset, EnvelopeReset, Bool[Array, " n"]]:
        """Return the new envelopes for this sample, those to keep, and True for joints that get one now [n].

        - `e`, `de`: error and its rate [n].
        - `drawn`: the prescribed envelope.
        - `slowness`: 1/a, with the acceleration a that the torque limits allow [n], s²/rad or s²/m; 0 without limits.
        - `lead_time`: c [s].
        - `now`: the new envelopes that the last sample kept.
        """
        inner = jnp.minimum(-drawn.lower, drawn.upper)
        speed = jnp.abs(de)
        needed = self.room * (jnp.abs(e) + lead_time * speed + 0.5 * de * de * slowness)
        # A cubic starts with the rate 3 R0/span, which may take no more than a quarter of the led radius.
        span = jnp.maximum(
            jnp.maximum(self.deadline, 12.0 * lead_time), jnp.sqrt(6.0 * needed * slowness / self.share + TINY)
        )
        radius = needed / (1.0 - 3.0 * lead_time / span)
        fresh = EnvelopeReset(t + span, span, jnp.maximum(radius - inner, 0.0), now.outside)

        active = t < now.until
        in_force = inner + now.excess_rate_curvature(t)[0]
        outside = jnp.where(active, jnp.abs(e) >= in_force, (e <= drawn.lower) | (e >= drawn.upper))
        # An envelope from a fast motion is far too wide and slow once the joint has slowed down.
        loose = active & (in_force > LOOSE * jnp.maximum(radius, inner)) & (fresh.until < now.until)
        new = outside | loose
        confirmed = loose | (outside & now.outside)
        kept = _where(confirmed, fresh, now)
        return _where(new, fresh, now), EnvelopeReset(kept.until, kept.span, kept.excess, outside), new

    def frame(
        self, t: Scalar, lead_time: Scalar, horizon: Scalar, drawn: EnvelopeFrame, now: EnvelopeReset
    ) -> EnvelopeFrame:
        """Return the envelope of the led error `e + c ė`, with new envelopes in place of prescribed ones.

        - `lead_time`, `horizon`: c and H [s].
        - `drawn`: the prescribed envelope of the led error.
        - `now`: the new envelopes at this sample.
        """
        if drawn.sides is None:
            return drawn
        active = t < now.until
        inner = jnp.minimum(-drawn.sides.lower, drawn.sides.upper)
        x, dx, ddx = now.excess_rate_curvature(t)
        # At its end the cubic flattens faster than the lead can follow.
        led = jnp.maximum(x + lead_time * dx, 0.0)
        ahead = jnp.maximum(led + horizon * (dx + lead_time * ddx), 0.0)
        return EnvelopeFrame(
            now=jnp.where(active, inner * drawn.now + led, drawn.now),
            ahead=jnp.where(active, inner * drawn.ahead + ahead, drawn.ahead),
            sides=Sides(
                lower=jnp.where(active, -1.0, drawn.sides.lower), upper=jnp.where(active, 1.0, drawn.sides.upper)
            ),
        )


def _where(condition: Bool[Array, " n"], yes: EnvelopeReset, no: EnvelopeReset) -> EnvelopeReset:
    return EnvelopeReset(
        until=jnp.where(condition, yes.until, no.until),
        span=jnp.where(condition, yes.span, no.span),
        excess=jnp.where(condition, yes.excess, no.excess),
        outside=no.outside,
    )
