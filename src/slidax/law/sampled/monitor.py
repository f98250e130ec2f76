"""The guarantee monitor: compare each sample with the assumptions under which the error stays in its envelope.

The led error is `y = e + c ė` with the lead time `c = H - h/2`, the horizon H of the law's plan and the period h.
"""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool

from slidax.core.errors import DefinitionError, is_traced
from slidax.core.parameter import parameter
from slidax.core.part import AbstractPart
from slidax.core.types import Envelope, PerJoint, Scalar, State, Vector

from ..adaptation import LearnedParameters
from .prediction import advance

MISSED = 1.0
"""`assumption_violated`: the estimation error, or torque that the limits withheld, exceeds the guarantee's bound."""

INERTIA = 2.0
"""`assumption_violated`: the learnt inertia of a joint is outside the range of the guarantee."""

NO_ROOM = 4.0
"""`assumption_violated`: the led error is nearer to its envelope than the guarantee allows; the error will follow."""

UNMODELLED = 8.0
"""`assumption_violated`: the estimated disturbance of a joint exceeds the bound of the guarantee."""

FASTER = 4.0
"""Speed of the second filter, which uses measured positions, over that of the horizon."""


class MonitorMemory(eqx.Module):
    """Memory of a `Monitor` between two samples.

    - `begun`: True after the first sample.
    - `missed`: x, the unplanned part of the led error [n], rad or m.
    - `expected`: planned state at the next sample, from the law's own estimate.
    - `followed`: planned state at the next sample, from the monitor's own filter of measured positions.
    """

    begun: Bool[Array, ""]
    missed: Vector
    expected: State
    followed: State


def used_share(y: Vector, share: PerJoint, envelope: Envelope) -> Array:
    """Largest ratio, over the joints, of `y` [n] to `share` times the side of the envelope towards which y points."""
    return jnp.max(jnp.maximum(y / (share * envelope.upper), y / (share * envelope.lower)))


class Monitor(AbstractPart):
    """Warn before the error leaves its envelope: the led error y reaches its bound about one horizon earlier.

    In one period a plan over the horizon H moves `y = e + c ė` by the share `r = h/H` towards a value inside the
    envelope. Unplanned motion adds to this. y is therefore the sum of a part that stays inside for any plan, and a part
    x that comes only from unplanned motion (docs/sampled-data.md):

        x⁺ = (1 - r) x + (q - q_planned) + c (q̇ - q̇_planned),

    with the predicted state (q, q̇) and the state that the last step planned. Torque that the limits withheld adds to x.
    An estimator that is slower than the horizon shows x too late. A second filter therefore computes x and y from
    measured positions, and the larger values count. It is an α-β filter around the plan with the poles `p1 = 1 - h/H`
    and `p2 = 1 - 4 h/H`; its innovation times `(1 - p2) H/h` is x delayed by the second pole.

    The loop-rate rule bounds x by `share`, and y by `led`, times the envelope's side towards which they point, at
    t + c (docs/loop-rate.md). The other side may be narrower: x does not move the error there. e is a weighted mean of
    the past y, so that e cannot leave before y does.

    Signals: `margin`, the least of `1 - x/(share b ρ)`, `1 - y/(led b ρ)` and `1 - |ŵ|/disturbance` of all joints, with
    the envelope's side b ρ towards which x and y point and the estimated disturbance ŵ; negative if one of the three is
    beyond its bound; `assumption_violated`, a sum of `1`: x is too large, `2`: a learnt inertia is outside the range of
    the guarantee, `4`: y is too near to its envelope, `8`: the estimated disturbance is larger than `disturbance`. For
    a law without a plan only the last check is made.
    """

    title = "Guarantee monitor: each sample is compared with the assumptions of the guarantee."

    share: PerJoint = parameter(
        "share of the envelope's side that the estimation error may take up",
        "",
        "(0, 1]",
        default=0.5,
        source="docs/certificates/index.md",
    )
    led: PerJoint = parameter(
        "share of its envelope that the led error may take up",
        "",
        "(0, 1]",
        default=0.95,
        source="docs/certificates/index.md",
    )
    rotor_min: PerJoint | None = parameter(
        "least learnt inertia (in addition to that of the links) that the guarantee covers; None for any",
        "kg m² or kg",
        default=None,
    )
    rotor_max: PerJoint | None = parameter(
        "largest learnt inertia (in addition to that of the links) that the guarantee covers; None for any",
        "kg m² or kg",
        default=None,
    )

    disturbance: PerJoint | None = parameter(
        "largest estimated disturbance that the guarantee covers, as `slidax admit` computes it; None for any",
        "rad/s² or m/s²",
        "> 0",
        default=None,
        source="docs/certificates/index.md",
    )

    def __check_init__(self) -> None:
        low, high = self.rotor_min, self.rotor_max
        if low is not None and high is not None and not is_traced((low, high)) and not bool((low <= high).all()):
            raise DefinitionError(f"`Monitor.rotor_min` must be <= `rotor_max`; got {low} and {high}")

    def init(self, state: State) -> MonitorMemory:
        """Return the memory before the first sample, from the measured state."""
        return MonitorMemory(jnp.zeros((), bool), jnp.zeros_like(state.q), state, state)

    def __call__(
        self,
        now: State,
        unseen: Vector,
        desired: State,
        wanted: Vector,
        fresh: Bool[Array, ""],
        envelope: Envelope,
        learnt: LearnedParameters | None,
        disturbance: Vector,
        span: tuple[Scalar, Scalar],
        memory: MonitorMemory,
    ) -> tuple[MonitorMemory, dict[str, Array]]:
        """Return the memory and the signals after a sample.

        - `now`: predicted state when this sample's torque sets in.
        - `unseen`: measured minus estimated positions [n], rad or m.
        - `desired`: desired state at that time.
        - `wanted`: acceleration that the step planned [n].
        - `fresh`: True if the last sample was one period ago.
        - `envelope`: the prescribed envelope at the time c after the torque sets in, rad or m.
        - `learnt`: estimated parameters of the joints; None without an adaptation.
        - `disturbance`: estimated disturbance ŵ [n], rad/s² or m/s².
        - `span`: h and H [s].
        """
        (period, horizon), expected = span, memory.expected
        lead_time = horizon - 0.5 * period
        revised = now.q - expected.q + lead_time * (now.dq - expected.dq)
        missed = (1.0 - period / horizon) * memory.missed + jnp.where(fresh & memory.begun, revised, 0.0)
        usual = fresh & memory.begun
        measured = now.q + unseen
        quick = jnp.minimum(FASTER * period / horizon, 1.0)
        surprise = jnp.where(usual, measured - memory.followed.q, 0.0)
        slow = period / horizon
        position = jnp.where(usual, memory.followed.q + (slow + quick - slow * quick) * surprise, measured)
        speed = jnp.where(usual, memory.followed.dq + slow * quick / period * surprise, now.dq)
        followed = State(q=position, dq=speed)
        of_room = jnp.maximum(
            used_share(missed, self.share, envelope), used_share(surprise * (quick / slow), self.share, envelope)
        )
        of_way = jnp.maximum(
            used_share(now.q - desired.q + lead_time * (now.dq - desired.dq), self.led, envelope),
            used_share(measured - desired.q + lead_time * (speed - desired.dq), self.led, envelope),
        )
        violated = jnp.where(of_room > 1.0, MISSED, 0.0) + jnp.where(of_way > 1.0, NO_ROOM, 0.0)
        unmodelled = self.without_plan(disturbance)
        violated = violated + unmodelled["assumption_violated"]
        margin = jnp.minimum(1.0 - jnp.maximum(of_room, of_way), unmodelled["margin"])
        if learnt is not None:
            violated = violated + jnp.where(self._unlike(learnt.rotor), INERTIA, 0.0)
        planned = advance(now, wanted, period), advance(followed, wanted, period)
        kept = MonitorMemory(jnp.ones((), bool), missed, *planned)
        return kept, {"margin": margin, "assumption_violated": violated}

    def without_plan(self, disturbance: Vector) -> dict[str, Array]:
        """Return `margin`, the least `1 - |ŵ|/disturbance` of all joints, and `assumption_violated`, 8 or 0.

        - `disturbance`: the estimated disturbance ŵ [n], rad/s² or m/s².
        """
        bound = jnp.inf if self.disturbance is None else self.disturbance
        ratio = jnp.max(jnp.abs(disturbance) / bound)
        return {"margin": 1.0 - ratio, "assumption_violated": jnp.where(ratio > 1.0, UNMODELLED, 0.0)}

    def _unlike(self, rotor: Vector) -> Bool[Array, ""]:
        """True if a learnt inertia is outside the range of the guarantee."""
        unlike = jnp.zeros((), bool)
        if self.rotor_min is not None:
            unlike = unlike | jnp.any(rotor < self.rotor_min)
        if self.rotor_max is not None:
            unlike = unlike | jnp.any(rotor > self.rotor_max)
        return unlike
