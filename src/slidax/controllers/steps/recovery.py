"""What a law does outside its envelope: it draws a new one around the error, which narrows into the old."""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool

from slidax._types import Envelope
from slidax.parts import AbstractPart, Scalar, Vector, parameter
from slidax.transformations import Frame, Sides

TINY = 1e-30
"""Keeps the derivative of a square root finite where there are no limits."""

LOOSE = 4.0
"""An envelope this many times wider than a new one would be is replaced by that."""


class Reseat(eqx.Module):
    """The envelopes that are in force in place of the drawn ones, as excess over the inner radius; all [n].

    - `until`: when they end [s].
    - `span`: how long they last [s].
    - `excess`: by how much they are wider at their start, rad or m.
    - `outside`: True if the joint was outside at the last sample.
    """

    until: Vector
    span: Vector
    excess: Vector
    outside: Bool[Array, " n"]

    def excess_rate_curvature(self, t: Scalar) -> tuple[Vector, Vector, Vector]:
        """`X = excess (1 - (t - t_r)/span)³` and its two derivatives, [n]; 0 from `until` on.

        - `t`: time [s].
        """
        left = jnp.clip((self.until - t) / self.span, 0.0, 1.0)
        per_second = 1.0 / self.span
        x = self.excess * left
        return x * left * left, -3.0 * x * left * per_second, 6.0 * x * per_second * per_second


class Recovery(AbstractPart):
    """The policy `recover`: when a joint is outside, `|e| < ϑ ρ(t) + X(t)` takes the place of its drawn envelope.

    X begins with `R0 = room (|e| + c |ė| + ė²/(2a))`, so that there is room to brake with the acceleration a that the
    torque limits leave, and ends after `max(deadline, sqrt(6 R0/(share a)))` as a cubic, whose own curvature asks for
    no more than `share a`. From then on the drawn envelope is in force again. Where X is four times wider than it would
    be if it began now, it begins anew.

    One sample cannot set X: the first sample outside is answered with the X that it asks for, but X is kept only if the
    next sample is outside, too.
    """

    title = "What a law does outside its envelope: it draws a new one around the error, which narrows into the old."

    deadline: Scalar = parameter("least time for the way back", "s", "> 0", default=0.3)
    room: Scalar = parameter(
        "how much wider than needed to brake", "", "> 1", "so that there is room to brake", default=1.6
    )
    share: Scalar = parameter(
        "of the acceleration at hand that the new envelope may ask for", "", "(0, 1)", default=0.25
    )

    def init(self, t: Scalar, joints: int) -> Reseat:
        """No envelope but the drawn ones.

        - `t`: time at the start [s].
        - `joints`: number of joints.
        """
        zero = jnp.zeros(joints)
        return Reseat(until=zero + t, span=zero + 1.0, excess=zero, outside=jnp.zeros(joints, bool))

    def reseat(
        self, t: Scalar, e: Vector, de: Vector, drawn: Envelope, slowness: Vector, lead: Scalar, now: Reseat
    ) -> tuple[Reseat, Reseat, Bool[Array, " n"]]:
        """The envelopes in force at this sample, those that are kept for the next, and which of them are new.

        - `t`: time [s].
        - `e`, `de`: error and its rate [n].
        - `drawn`: the drawn envelope.
        - `slowness`: 1/a, a the acceleration that the torque limits leave [n], s²/rad or s²/m; 0 without limits.
        - `lead`: c [s].
        - `now`: those in force before.
        """
        inner = jnp.minimum(-drawn.lower, drawn.upper)
        speed = jnp.abs(de)
        needed = self.room * (jnp.abs(e) + lead * speed + 0.5 * de * de * slowness)
        # A cubic begins with the rate 3 R0/span, which the led radius must not lose more than a quarter to.
        span = jnp.maximum(
            jnp.maximum(self.deadline, 12.0 * lead), jnp.sqrt(6.0 * needed * slowness / self.share + TINY)
        )
        radius = needed / (1.0 - 3.0 * lead / span)
        fresh = Reseat(t + span, span, jnp.maximum(radius - inner, 0.0), now.outside)

        active = t < now.until
        in_force = inner + now.excess_rate_curvature(t)[0]
        outside = jnp.where(active, jnp.abs(e) >= in_force, (e <= drawn.lower) | (e >= drawn.upper))
        # One that was drawn in full flight is far too wide and slow once the joint has been caught.
        loose = active & (in_force > LOOSE * jnp.maximum(radius, inner)) & (fresh.until < now.until)
        new = outside | loose
        confirmed = loose | (outside & now.outside)
        kept = _where(confirmed, fresh, now)
        return _where(new, fresh, now), Reseat(kept.until, kept.span, kept.excess, outside), new

    def frame(self, t: Scalar, lead: Scalar, horizon: Scalar, drawn: Frame, now: Reseat) -> Frame:
        """The frame of a plan, with the new envelopes where they are in force.

        - `t`: time [s].
        - `lead`, `horizon`: c and H [s].
        - `drawn`: the frame of the drawn envelope.
        - `now`: the envelopes in force.
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
