"""Recovery outside the envelope: a new envelope around the error narrows into the prescribed one."""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool

from slidax._types import Envelope
from slidax.parts import AbstractPart, Scalar, Vector, parameter
from slidax.transformations import Frame, Sides

TINY = 1e-30
"""Keeps the derivative of a square root finite without torque limits."""

LOOSE = 4.0
"""A new envelope replaces one that is wider by this factor."""


class Reseat(eqx.Module):
    """Envelopes that replace the prescribed ones, as excess over the inner radius; all [n].

    - `until`: end time [s].
    - `span`: duration [s].
    - `excess`: excess at their start, rad or m.
    - `outside`: True if the joint was outside at the last sample.
    """

    until: Vector
    span: Vector
    excess: Vector
    outside: Bool[Array, " n"]

    def excess_rate_curvature(self, t: Scalar) -> tuple[Vector, Vector, Vector]:
        """Return `X = excess (1 - (t - t_r)/span)³` and its two derivatives, [n]; 0 from `until` on."""
        left = jnp.clip((self.until - t) / self.span, 0.0, 1.0)
        per_second = 1.0 / self.span
        x = self.excess * left
        return x * left * left, -3.0 * x * left * per_second, 6.0 * x * per_second * per_second


class Recovery(AbstractPart):
    """The policy `recover`: while a joint is outside, `|e| < ϑ ρ(t) + X(t)` replaces its prescribed envelope.

    X starts at `R0 = room (|e| + c |ė| + ė²/(2a))`, which leaves the distance to brake with the acceleration a within
    the torque limits. X is a cubic that ends after `max(deadline, sqrt(6 R0/(share a)))`; its curvature needs no more
    than `share a`. Then the prescribed envelope is in force again. X starts anew once it is four times wider than a new
    X would be.

    One sample cannot set X: the first sample outside uses its own X, but X stays only if the next sample is outside,
    too.
    """

    title = "Recovery outside the envelope: a new envelope around the error narrows into the prescribed one."

    deadline: Scalar = parameter("least time for the way back", "s", "> 0", default=0.3)
    room: Scalar = parameter(
        "how much wider than needed to brake", "", "> 1", "so that there is room to brake", default=1.6
    )
    share: Scalar = parameter(
        "of the acceleration at hand that the new envelope may ask for", "", "(0, 1)", default=0.25
    )

    def init(self, t: Scalar, joints: int) -> Reseat:
        """Return the prescribed envelopes alone, at the start time t [s]."""
        zero = jnp.zeros(joints)
        return Reseat(until=zero + t, span=zero + 1.0, excess=zero, outside=jnp.zeros(joints, bool))

    def reseat(
        self, t: Scalar, e: Vector, de: Vector, drawn: Envelope, slowness: Vector, lead: Scalar, now: Reseat
    ) -> tuple[Reseat, Reseat, Bool[Array, " n"]]:
        """Return the envelopes at this sample, those for the next sample, and True for each new one.

        - `e`, `de`: error and its rate [n].
        - `drawn`: the prescribed envelope.
        - `slowness`: 1/a, with the acceleration a within the torque limits [n], s²/rad or s²/m; 0 without limits.
        - `lead`: c [s].
        - `now`: the envelopes before this sample.
        """
        inner = jnp.minimum(-drawn.lower, drawn.upper)
        speed = jnp.abs(de)
        needed = self.room * (jnp.abs(e) + lead * speed + 0.5 * de * de * slowness)
        # A cubic starts with the rate 3 R0/span, which may take no more than a quarter of the led radius.
        span = jnp.maximum(
            jnp.maximum(self.deadline, 12.0 * lead), jnp.sqrt(6.0 * needed * slowness / self.share + TINY)
        )
        radius = needed / (1.0 - 3.0 * lead / span)
        fresh = Reseat(t + span, span, jnp.maximum(radius - inner, 0.0), now.outside)

        active = t < now.until
        in_force = inner + now.excess_rate_curvature(t)[0]
        outside = jnp.where(active, jnp.abs(e) >= in_force, (e <= drawn.lower) | (e >= drawn.upper))
        # An envelope from a fast motion is far too wide and slow once the joint has slowed down.
        loose = active & (in_force > LOOSE * jnp.maximum(radius, inner)) & (fresh.until < now.until)
        new = outside | loose
        confirmed = loose | (outside & now.outside)
        kept = _where(confirmed, fresh, now)
        return _where(new, fresh, now), Reseat(kept.until, kept.span, kept.excess, outside), new

    def frame(self, t: Scalar, lead: Scalar, horizon: Scalar, drawn: Frame, now: Reseat) -> Frame:
        """Return the frame of a plan, with new envelopes in place of prescribed ones.

        - `lead`, `horizon`: c and H [s].
        - `drawn`: frame of the prescribed envelope.
        - `now`: the envelopes at this sample.
        """
        if drawn.sides is None:
            return drawn
        active = t < now.until
        inner = jnp.minimum(-drawn.sides.lower, drawn.sides.upper)
        x, dx, ddx = now.excess_rate_curvature(t)
        # At its end the cubic flattens faster than the lead can follow.
        led = jnp.maximum(x + lead * dx, 0.0)
        ahead = jnp.maximum(led + horizon * (dx + lead * ddx), 0.0)
        return Frame(
            now=jnp.where(active, inner * drawn.now + led, drawn.now),
            ahead=jnp.where(active, inner * drawn.ahead + ahead, drawn.ahead),
            sides=Sides(
                lower=jnp.where(active, -1.0, drawn.sides.lower), upper=jnp.where(active, 1.0, drawn.sides.upper)
            ),
        )


def _where(condition: Bool[Array, " n"], yes: Reseat, no: Reseat) -> Reseat:
    return Reseat(
        until=jnp.where(condition, yes.until, no.until),
        span=jnp.where(condition, yes.span, no.span),
        excess=jnp.where(condition, yes.excess, no.excess),
        outside=no.outside,
    )
