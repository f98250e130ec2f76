"""Whether a promise still stands: what it was computed for, compared with what is measured, in every sample."""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool

from slidax._types import Envelope
from slidax.adaptation import Learnt
from slidax.parts import AbstractPart, DefinitionError, PerJoint, Scalar, State, Vector, is_traced, parameter

from .prediction import moved_on

MISSED = 1.0
"""`assumption_violated`: the estimate misses more than the promise allows, or the limits withhold as much."""

INERTIA = 2.0
"""`assumption_violated`: what was learnt of a joint's inertia is outside of what the promise is for."""

NO_ROOM = 4.0
"""`assumption_violated`: the led error is nearer to its envelope than the promise allows: the error will follow it."""


FASTER = 4.0
"""Times as fast as the horizon is the second look, at positions as they are measured."""


class Watched(eqx.Module):
    """What a monitor keeps between two samples.

    - `begun`: whether there was a sample before.
    - `missed`: x, the part of the led error that was not planned [n], rad or m.
    - `expected`: the state that was wanted for the next sample.
    - `followed`: the same by the second look, which knows of the positions alone.
    """

    begun: Bool[Array, ""]
    missed: Vector
    expected: State
    followed: State


class Monitor(AbstractPart):
    """Warns before an envelope is left, since the led error is seen a horizon earlier than the error itself.

    By `y⁺ = (1 - r) y + r (A ψ(ε) + Q w)` the led error `y = e + c ė`, `c = H - h/2`, is a part that stays inside for
    any plan, and one that only what was not planned makes (docs/sampled-data.md). The second is followed by itself,

        x⁺ = (1 - r) x + (q - q_planned) + c (q̇ - q̇_planned),

    with the state for which the step decides and the one for which the last step planned; torque that the limits
    withheld counts as missed. An estimator that is slower than the horizon shows that too late. So x and y are also
    followed from the positions as measured, by an α-β filter of what was planned with the poles `p1 = 1 - h/H` and
    `p2 = 1 - 4 h/H`, whose innovation times `(1 - p2) H/h` is x behind the second of them; the worse of both
    counts. The loop-rate rule promises that `|x| <= share ϑ ρ(t + c)`, and that y stays within `led`
    times its own envelope, of which e is a mean: e cannot leave before y does.

    Signals: `margin`, the least `1 - |x|/(share ϑ ρ)` and `1 - |y|/(led ρ)` of all joints, negative where the promise
    does not stand; `assumption_violated`, a sum of `1`: too much is missed, `2`: an inertia was learnt that the promise
    is not for, `4`: y has no room left.
    """

    title = "Whether a promise still stands: what it was computed for, compared with what is measured, in every sample."

    share: PerJoint = parameter(
        "of the envelope's nearer side that may be taken up by what the estimate misses",
        "",
        "(0, 1]",
        default=0.5,
        source="docs/certificates/monitor.md",
    )
    led: PerJoint = parameter(
        "of its envelope that may be taken up by the led error",
        "",
        "(0, 1]",
        default=0.95,
        source="docs/certificates/monitor.md",
    )
    rotor_min: PerJoint | None = parameter(
        "least inertia beside that of the links for which the promise is; None for any",
        "kg m² or kg",
        default=None,
    )
    rotor_max: PerJoint | None = parameter(
        "largest inertia beside that of the links for which the promise is; None for any",
        "kg m² or kg",
        default=None,
    )

    def __check_init__(self) -> None:
        low, high = self.rotor_min, self.rotor_max
        if low is not None and high is not None and not is_traced((low, high)) and not bool((low <= high).all()):
            raise DefinitionError(f"`Monitor.rotor_min` must be <= `rotor_max`; got {low} and {high}")

    def init(self, state: State) -> Watched:
        """Nothing is missed yet.

        - `state`: measured positions and velocities.
        """
        return Watched(jnp.zeros((), bool), jnp.zeros_like(state.q), state, state)

    def __call__(
        self,
        now: State,
        unseen: Vector,
        desired: State,
        wanted: Vector,
        fresh: Bool[Array, ""],
        envelope: Envelope,
        learnt: Learnt | None,
        span: tuple[Scalar, Scalar],
        memory: Watched,
    ) -> tuple[Watched, dict[str, Array]]:
        """What is kept, and the signals.

        - `now`: the state when this sample's torque sets in, as it is predicted.
        - `unseen`: by how much the measured positions are beyond what the estimator makes of them [n], rad or m.
        - `desired`: where the joints should be then.
        - `wanted`: acceleration that the step decided for [n].
        - `fresh`: whether the last sample was one period ago.
        - `envelope`: the drawn one, c later [rad or m].
        - `learnt`: what is believed of the joints; None if nothing is learnt.
        - `span`: h and H [s].
        - `memory`: what `init` or the last sample returned.
        """
        (period, horizon), expected = span, memory.expected
        lead = horizon - 0.5 * period
        revised = now.q - expected.q + lead * (now.dq - expected.dq)
        missed = (1.0 - period / horizon) * memory.missed + jnp.where(fresh & memory.begun, revised, 0.0)
        usual = fresh & memory.begun
        seen = now.q + unseen
        quick = jnp.minimum(FASTER * period / horizon, 1.0)
        surprise = jnp.where(usual, seen - memory.followed.q, 0.0)
        slow = period / horizon
        position = jnp.where(usual, memory.followed.q + (slow + quick - slow * quick) * surprise, seen)
        speed = jnp.where(usual, memory.followed.dq + slow * quick / period * surprise, now.dq)
        followed = State(q=position, dq=speed)
        most = jnp.maximum(jnp.abs(missed), jnp.abs(surprise) * (quick / slow))
        of_room = jnp.max(most / (self.share * jnp.minimum(envelope.upper, -envelope.lower)))
        of_way = jnp.maximum(
            self._way(now.q - desired.q + lead * (now.dq - desired.dq), envelope),
            self._way(seen - desired.q + lead * (speed - desired.dq), envelope),
        )
        violated = jnp.where(of_room > 1.0, MISSED, 0.0) + jnp.where(of_way > 1.0, NO_ROOM, 0.0)
        margin = 1.0 - jnp.maximum(of_room, of_way)
        if learnt is not None:
            violated = violated + jnp.where(self._unlike(learnt.rotor), INERTIA, 0.0)
        planned = moved_on(now, wanted, period), moved_on(followed, wanted, period)
        kept = Watched(jnp.ones((), bool), missed, *planned)
        return kept, {"margin": margin, "assumption_violated": violated}

    def _way(self, y: Vector, envelope: Envelope) -> Array:
        """How much of its envelope the led error takes up, where it takes most.

        - `y`: the led error [n], rad or m.
        - `envelope`: as drawn.
        """
        return jnp.max(jnp.maximum(y / (self.led * envelope.upper), y / (self.led * envelope.lower)))

    def _unlike(self, rotor: Vector) -> Bool[Array, ""]:
        """Whether what was learnt is not what the promise is for."""
        unlike = jnp.zeros((), bool)
        if self.rotor_min is not None:
            unlike = unlike | jnp.any(rotor < self.rotor_min)
        if self.rotor_max is not None:
            unlike = unlike | jnp.any(rotor > self.rotor_max)
        return unlike
