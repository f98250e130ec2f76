"""Implicit step of every law with a surface `s = ė + φ(t, e)`."""

from __future__ import annotations

from abc import abstractmethod
from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool

from slidax._types import Envelope, Reference
from slidax.numerics import matvec, once
from slidax.parts import Matrix, Memory, Scalar, State, Vector, piece, require_joints
from slidax.robots import AbstractRobot
from slidax.surfaces import AbstractSurface
from slidax.transformations import AbstractTransformation, Frame

from .plan import Barrier, Plan
from .recovery import Recovery, Reseat
from .step import AbstractStep, Decision, Moment


class Followed(eqx.Module):
    """Memory of a step with a surface.

    - `sides`: memory of the transformation.
    - `s`: planned sliding variable at the next sample [n].
    - `eps`: guess of the next plan's transformed error [n].
    - `last_eps`: the last plan's transformed error [n].
    - `reseat`: envelopes that replace the prescribed ones; None without a recovery.
    - `reaching`: memory of the reaching law.
    """

    sides: Memory
    s: Vector
    eps: Vector
    last_eps: Vector
    reseat: Reseat | None
    reaching: Memory


class Reached(eqx.Module):
    """One implicit step of a reaching law.

    - `s_next`: the sliding variable s⁺ at the end of the horizon [n], rad/s or m/s.
    - `memory`: of the reaching law, for the next sample.
    - `cover`: largest disturbance that it covers, N m; None without a bound.
    - `signals`: inner quantities by name.
    """

    s_next: Vector
    memory: Memory
    cover: Scalar | None
    signals: dict[str, Array]


class AbstractSurfaceStep(AbstractStep):
    """The law `s = ė + φ(t, e)` as one implicit Euler step over the horizon H, repeated in every period h.

    With the led error `y = e + c ė`, `c = H - h/2`, its radius `ρ_y = ρ + c ρ̇` and `ρ_a = ρ_y + H ρ̇_y`:

    1. s⁺ by the reaching law, implicitly;
    2. `ρ_y ψ(ε) + H pull(ε) = y + H s⁺`: one ε for each joint;
    3. `v⁺ = (ρ_a ψ(ε) - y)/H`: the velocity error at the end of the horizon;
    4. `q̈ = q̈_r + (v⁺ - ė)/H`, `q̈_r = (q̇_d(t + h) - q̇_d(t))/h`.

    Without a disturbance y moves to `(1 - h/H) y + (h/H) ρ_a ψ(ε)` in one period, and e to a convex mean of itself and
    both y. Neither leaves the envelope (docs/sampled-data.md). Each step has exactly one solution for every
    measurement, inside or outside.
    """

    nominal: AbstractRobot = piece("the robot as the law knows it, M0, C0, G0")
    transformation: AbstractTransformation = piece("as in the printed law: e to ε1")
    surface: AbstractSurface = piece("as in the printed law: the pull on ε1")
    recovery: Recovery | None = piece("what to do outside the envelope; without it, pull back to the drawn one")
    plans: ClassVar[bool] = True

    def __check_init__(self) -> None:
        for part in (self.transformation, self.surface):
            require_joints(part, self.nominal.joints, type(self.nominal).__name__)

    @property
    def robot(self) -> AbstractRobot:
        return self.nominal

    @abstractmethod
    def reach_init(self) -> Memory:
        """Return the reaching law's memory at the start."""

    @abstractmethod
    def reach(self, moment: Moment, plan: Plan, memory: Memory) -> Reached:
        """Return one implicit step of the reaching law.

        - `moment`: the predicted arm.
        - `plan`: start of the step, with s.
        - `memory`: from `reach_init` or the last sample.
        """

    def init(self, t: Scalar, state: State, reference: Reference, period: Scalar, horizon: Scalar | None) -> Memory:
        assert horizon is not None
        lead = horizon - 0.5 * period
        e, de = state.q - reference.q, state.dq - reference.dq
        sides = self.transformation.init(t, e)
        eps = self.transformation.frame(t, lead, horizon, sides).transformed(e + lead * de)
        return Followed(
            sides=sides,
            s=jnp.zeros_like(e),
            eps=eps,
            last_eps=eps,
            reseat=None if self.recovery is None else self.recovery.init(t, self.nominal.joints),
            reaching=self.reach_init(),
        )

    def restarted(self, t: Scalar, memory: Followed) -> Memory:
        """Reset the recovery; the sides of the prescribed envelope stay."""
        if self.recovery is None:
            return memory
        return eqx.tree_at(lambda kept: kept.reseat, memory, self.recovery.init(t, self.nominal.joints))

    def recovers(self, t: Scalar, memory: Followed) -> Bool[Array, ""]:
        if memory.reseat is None:
            return jnp.zeros((), bool)
        return jnp.any(t < memory.reseat.until)

    def __call__(self, moment: Moment, memory: Followed) -> Decision:
        h, horizon, now, desired = moment.period, moment.horizon, moment.state, moment.reference
        assert horizon is not None
        lead = horizon - 0.5 * h
        e, v = now.q - desired.q, now.dq - desired.dq
        y = e + lead * v
        frame = self.transformation.frame(moment.t, lead, horizon, memory.sides)
        reseat, kept_reseat, planned = memory.reseat, memory.reseat, moment.planned
        if self.recovery is not None and reseat is not None:
            drawn = self.transformation.envelope(moment.t, memory.sides)
            if drawn is not None:
                reseat, kept_reseat, fresh = self.recovery.reseat(
                    moment.t, e, v, drawn, _slowness(moment), lead, reseat
                )
                planned = planned & ~jnp.any(fresh)
                frame = self.recovery.frame(moment.t, lead, horizon, frame, reseat)
        frame = once(frame)

        # The planned s plus the velocity's deviation, so that φ's slope does not multiply position errors.
        s, eps_guess = jax.lax.cond(
            planned,
            lambda: (memory.s + now.dq - moment.expected, memory.eps),
            lambda: self._measured(frame, y, v, horizon),
        )
        plan = Plan.near(Barrier(frame, self.surface, horizon), y, v, s, eps_guess)
        reached = self.reach(moment, plan, memory.reaching)
        eps, beyond = plan.towards(reached.s_next)
        acceleration = desired.ddq + beyond

        kept = Followed(
            sides=memory.sides,
            s=s + (reached.s_next - s) * (h / horizon),
            # Extrapolation of the last two plans: most plans are one Newton step away from it.
            eps=jnp.where(planned, 2.0 * eps - memory.last_eps, eps),
            last_eps=eps,
            reseat=kept_reseat,
            reaching=reached.memory,
        )
        signals = {"s": s, "s_next": reached.s_next, "eps1": eps, **reached.signals}
        if reseat is not None:
            signals["reseated"] = (moment.t < reseat.until).astype(float)
        stands = eqx.tree_at(lambda kept: kept.reaching, kept, memory.reaching)
        return Decision(
            tau=matvec(moment.mass, acceleration) + moment.bias,
            acceleration=acceleration,
            memory=kept,
            signals=signals,
            cover=reached.cover,
            limited=stands if jax.tree.leaves(memory.reaching) else None,
        )

    def envelope(self, t: Scalar, memory: Followed) -> Envelope | None:
        """Return the prescribed envelope, also during a recovery."""
        return self.transformation.envelope(t, memory.sides)

    def _measured(self, frame: Frame, y: Vector, v: Vector, horizon: Scalar) -> tuple[Vector, Vector]:
        """`s = ė + φ(t, y)` and ε from the measurement, with y clipped to the frame."""
        eps = frame.transformed(y)
        drift = (frame.now - frame.ahead) / (horizon * frame.now)
        return v + drift * y + self.surface.pull_and_slope(eps)[0], eps


def _slowness(moment: Moment) -> Vector:
    """1/a, with the acceleration a of each joint within the limits, for the arm's weight and coupled inertia."""
    limit = moment.limits.torque
    mass: Matrix = jnp.abs(moment.mass)
    return jnp.sum(mass, axis=1) / jnp.maximum(limit - jnp.abs(moment.bias), 0.25 * limit)
