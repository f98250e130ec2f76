"""Implicit Euler steps of controllers with a sliding surface `s = ė + A e + φ(ε1)`, the paper's eq. (40).

In each period h a step computes a plan: one implicit Euler step over the horizon H. s⁺ is the sliding variable at the
plan's end. A plan uses the led error `y = e + c ė`, the tracking error e extrapolated by the lead time `c = H - h/2`.
The paper is Nonlinear Dynamics (2022), doi 10.1007/s11071-022-07650-w.
"""

from __future__ import annotations

from abc import abstractmethod
from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool

from slidax.arms.arm import AbstractRobot
from slidax.core.errors import require_joints
from slidax.core.linear_algebra import matvec
from slidax.core.parameter import parameter, piece
from slidax.core.root_finding import increasing_root
from slidax.core.tracing import barrier
from slidax.core.types import Envelope, Matrix, Memory, PerJoint, Reference, Scalar, State, Vector

from .error_transformations import AbstractTransformation, EnvelopeFrame
from .reaching_laws import AbstractReaching
from .steps import AbstractStep, Decision, EnvelopeReset, Recovery, StepInput
from .surfaces import AbstractSurface
from .torque_bounds import AbstractBound

PRECISION = 1e-12
"""rad/s or m/s: tolerance of a plan's equation, divided by H, in addition to rounding."""

ROUNDING = 4e-16
"""Rounding error of a sum, relative to its largest term."""


class Barrier(eqx.Module):
    """Equation `f(ε) = y + H s⁺` for the transformed error ε at the end of a plan, with `f(ε) = ρ_y ψ(ε) + H φ(ε)`.

    f increases from -∞ to ∞: there is exactly one ε for every led error y and every sliding variable s⁺.

    - `frame`: envelope of the led error, with its radius ρ_y and its transformation ψ.
    - `surface`: φ.
    - `horizon`: H [s].
    """

    frame: EnvelopeFrame
    surface: AbstractSurface
    horizon: Scalar

    def value_and_slope(self, eps: Vector) -> tuple[Vector, Vector]:
        """Return `f(ε)`, [n], rad or m, and its derivative [n]."""
        psi, psi_slope = _psi_and_slope(self.frame, eps)
        phi, phi_slope = _phi_and_slope(self.surface, eps)
        now, horizon = self.frame.now, self.horizon
        return now * psi + horizon * phi, now * psi_slope + horizon * phi_slope

    def solve(self, target: Vector, guess: Vector, at_guess: tuple[Vector, Vector]) -> Vector:
        """Return the ε with `f(ε) = target`, [n].

        - `target`: y + H s⁺, [n], rad or m.
        - `guess`: ε at which the search begins [n].
        - `at_guess`: f and its derivative at the guess, [n] each.
        """
        size = jnp.abs(target)
        # At this ε, φ alone reaches the target; ψ and φ have the target's sign.
        far = 1.0 + self.surface.reach(size / self.horizon)
        bracket = (jnp.where(target < 0, -far, -1.0), jnp.where(target > 0, far, 1.0))
        tolerance = PRECISION * self.horizon + ROUNDING * size
        return increasing_root(_value_and_slope, self, target, guess, at_guess, bracket, tolerance)


class Plan(eqx.Module):
    """A plan before its equation `f(ε) = y + H s⁺` is solved: its start, and a guess of ε.

    - `barrier`: the equation, with f and ψ.
    - `y`, `v`, `s`: led error, rad or m, velocity error and sliding variable, rad/s or m/s, at the start [n].
    - `eps`: guess of ε, the transformed error at the plan's end [n].
    - `psi`, `psi_slope`: ψ at the guess and its derivative [n].
    - `value`, `slope`: f at the guess and its derivative [n].
    """

    barrier: Barrier
    y: Vector
    v: Vector
    s: Vector
    eps: Vector
    psi: Vector
    psi_slope: Vector
    value: Vector
    slope: Vector

    @staticmethod
    def near(barrier: Barrier, y: Vector, v: Vector, s: Vector, eps: Vector) -> Plan:
        """Return the plan with ψ and f evaluated at the guess `eps`; arguments as in `Plan`."""
        frame, horizon = barrier.frame, barrier.horizon
        psi, psi_slope = _psi_and_slope(frame, eps)
        phi, phi_slope = _phi_and_slope(barrier.surface, eps)
        value, slope = frame.now * psi + horizon * phi, frame.now * psi_slope + horizon * phi_slope
        return Plan(barrier, y, v, s, eps, psi, psi_slope, value, slope)

    def holding_acceleration(self) -> Vector:
        """Return the acceleration minus the reference's that keeps s constant, [n], rad/s² or m/s².

        It is approximate: one Newton step from the guess solves the plan's equation with s⁺ = s.
        """
        horizon = self.barrier.horizon
        psi = self.psi + self.psi_slope * (self.y + horizon * self.s - self.value) / self.slope
        return ((self.barrier.frame.ahead * psi - self.y) / horizon - self.v) / horizon

    def towards(self, s_next: Vector) -> tuple[Vector, Vector]:
        """Return ε at the plan's end [n], and the planned acceleration minus the reference's [n], rad/s² or m/s².

        - `s_next`: the sliding variable s⁺ at the plan's end [n], rad/s or m/s.
        """
        frame, horizon = self.barrier.frame, self.barrier.horizon
        eps = self.barrier.solve(self.y + horizon * s_next, self.eps, (self.value, self.slope))
        v_next = (frame.ahead * _psi_and_slope(frame, eps)[0] - self.y) / horizon
        return eps, (v_next - self.v) / horizon


# Traced once, and functions in exported C.
@jax.jit
def _psi_and_slope(frame: EnvelopeFrame, eps: Vector) -> tuple[Vector, Vector]:
    return frame.psi_and_slope(eps)


@jax.jit
def _phi_and_slope(surface: AbstractSurface, eps: Vector) -> tuple[Vector, Vector]:
    return surface.phi_and_slope(eps)


def _value_and_slope(barrier: Barrier, eps: Vector) -> tuple[Vector, Vector]:
    return barrier.value_and_slope(eps)


class SurfaceMemory(eqx.Module):
    """Memory of a step with a surface, between two samples.

    - `sides`: memory of the error transformation, such as the sides of the envelope.
    - `s`: planned sliding variable at the next sample [n], rad/s or m/s.
    - `eps`: guess of the transformed error at the end of the next plan [n].
    - `last_eps`: transformed error at the end of the last plan [n].
    - `reset`: envelopes of a `Recovery`, which replace the prescribed ones; None without a recovery.
    - `reaching`: memory of the reaching law.
    """

    sides: Memory
    s: Vector
    eps: Vector
    last_eps: Vector
    reset: EnvelopeReset | None
    reaching: Memory


class ReachingStep(eqx.Module):
    """Result of a reaching law's implicit step.

    - `s_next`: the sliding variable s⁺ at the end of the plan's horizon [n], rad/s or m/s.
    - `memory`: memory of the reaching law, for the next sample.
    - `cover`: largest norm of the disturbance torque that the law compensates, N m; None without a bound.
    - `signals`: inner quantities by name.
    """

    s_next: Vector
    memory: Memory
    cover: Scalar | None
    signals: dict[str, Array]


class AbstractSurfaceStep(AbstractStep):
    """A law with a surface as one implicit Euler step over the horizon H, in every period h.

    The led error `y = e + c ė` has the radius `ρ_y = ρ + c ρ̇` now, and `ρ_a = ρ_y + H ρ̇_y` one horizon later:

    1. s⁺ by the reaching law, implicitly;
    2. `ρ_y ψ(ε) + H φ(ε) = y + H s⁺`: one transformed error ε for each joint, with the surface's function φ;
    3. `v⁺ = (ρ_a ψ(ε) - y)/H`: the velocity error at the end of the horizon;
    4. `q̈ = q̈_r + (v⁺ - ė)/H`, `q̈_r = (q̇_d(t + h) - q̇_d(t))/h`.

    Without a disturbance y moves to `(1 - h/H) y + (h/H) ρ_a ψ(ε)` in one period, and e to a convex mean of e, y, and y
    one period later. Neither leaves the envelope (docs/sampled-data.md). Each step has exactly one solution for every
    measurement, inside or outside the envelope.
    """

    nominal: AbstractRobot = piece("the robot as the law knows it: inertia M0, Coriolis matrix C0, gravity torque G0")
    transformation: AbstractTransformation = piece("error transformation of the printed law: e to ε1")
    surface: AbstractSurface = piece("surface of the printed law: φ(ε1)")
    recovery: Recovery | None = piece("policy outside the envelope; None: return to the prescribed envelope")
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
    def reach(self, moment: StepInput, plan: Plan, memory: Memory) -> ReachingStep:
        """Return the reaching law's implicit step, with s⁺ at the horizon's end and the memory after this sample.

        - `moment`: predicted state, reference and model at the time when the torque sets in.
        - `plan`: the plan before its equation is solved, with the present s.
        - `memory`: from `reach_init` or the last sample.
        """

    def init(self, t: Scalar, state: State, reference: Reference, period: Scalar, horizon: Scalar | None) -> Memory:
        assert horizon is not None
        lead_time = horizon - 0.5 * period
        e, de = state.q - reference.q, state.dq - reference.dq
        sides = self.transformation.init(t, e)
        eps = self.transformation.frame(t, lead_time, horizon, sides).transformed(e + lead_time * de)
        return SurfaceMemory(
            sides=sides,
            s=jnp.zeros_like(e),
            eps=eps,
            last_eps=eps,
            reset=None if self.recovery is None else self.recovery.init(t, self.nominal.joints),
            reaching=self.reach_init(),
        )

    def restarted(self, t: Scalar, memory: SurfaceMemory) -> Memory:
        """Return the memory without the envelopes of a recovery; the sides of the prescribed envelope stay."""
        if self.recovery is None:
            return memory
        return eqx.tree_at(lambda kept: kept.reset, memory, self.recovery.init(t, self.nominal.joints))

    def recovers(self, t: Scalar, memory: SurfaceMemory) -> Bool[Array, ""]:
        if memory.reset is None:
            return jnp.zeros((), bool)
        return jnp.any(t < memory.reset.until)

    def __call__(self, moment: StepInput, memory: SurfaceMemory) -> Decision:
        h, horizon, now, desired = moment.period, moment.horizon, moment.state, moment.reference
        assert horizon is not None
        lead_time = horizon - 0.5 * h
        e, v = now.q - desired.q, now.dq - desired.dq
        y = e + lead_time * v
        frame = self.transformation.frame(moment.t, lead_time, horizon, memory.sides)
        reset, kept_reset, planned = memory.reset, memory.reset, moment.planned
        if self.recovery is not None and reset is not None:
            drawn = self.transformation.envelope(moment.t, memory.sides)
            if drawn is not None:
                reset, kept_reset, fresh = self.recovery.reset_envelope(
                    moment.t, e, v, drawn, _slowness(moment), lead_time, reset
                )
                planned = planned & ~jnp.any(fresh)
                frame = self.recovery.frame(moment.t, lead_time, horizon, frame, reset)
        frame = barrier(frame)

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

        kept = SurfaceMemory(
            sides=memory.sides,
            s=s + (reached.s_next - s) * (h / horizon),
            # Extrapolation of the last two plans: most plans are one Newton step away from it.
            eps=jnp.where(planned, 2.0 * eps - memory.last_eps, eps),
            last_eps=eps,
            reset=kept_reset,
            reaching=reached.memory,
        )
        signals = {"s": s, "s_next": reached.s_next, "eps1": eps, **reached.signals}
        if reset is not None:
            signals["envelope_reset"] = (moment.t < reset.until).astype(float)
        stands = eqx.tree_at(lambda kept: kept.reaching, kept, memory.reaching)
        return Decision(
            tau=matvec(moment.mass, acceleration) + moment.bias,
            acceleration=acceleration,
            memory=kept,
            signals=signals,
            cover=reached.cover,
            limited=stands if jax.tree.leaves(memory.reaching) else None,
        )

    def envelope(self, t: Scalar, memory: SurfaceMemory) -> Envelope | None:
        """Return the prescribed envelope, also during a recovery."""
        return self.transformation.envelope(t, memory.sides)

    def _measured(self, frame: EnvelopeFrame, y: Vector, v: Vector, horizon: Scalar) -> tuple[Vector, Vector]:
        """`s = ė - (ρ̇_y/ρ_y) y + φ(ε)` and ε from the measurement; ε is that of y clipped to the led envelope."""
        eps = frame.transformed(y)
        drift = (frame.now - frame.ahead) / (horizon * frame.now)
        return v + drift * y + self.surface.phi_and_slope(eps)[0], eps


def _slowness(moment: StepInput) -> Vector:
    """1/a [n], s²/rad or s²/m: a is an acceleration that the torque limit leaves to each joint after C0 q̇ + G0."""
    limit = moment.limits.torque
    mass: Matrix = jnp.abs(moment.mass)
    return jnp.sum(mass, axis=1) / jnp.maximum(limit - jnp.abs(moment.bias), 0.25 * limit)


class SlidingStep(AbstractSurfaceStep):
    """Implicit step of the paper's law (41)-(45): `A (s⁺ - s) = -P(s⁺) - u N(s⁺)`, with `A = M0/H`.

    P and N are the continuous term and the switching direction of the reaching law; the paper has `P = K0 Sig^r`. The
    compensated disturbance torque has at most the norm u.

    Signals: `s`, `s_next` (s⁺), `eps1` [n], `u`; with a recovery `envelope_reset` [n], 1 where it acts.
    """

    reaching: AbstractReaching = piece("reaching law of the printed law: drives s to zero")
    bound: AbstractBound = piece("bound of the printed law: size u of the robust torque")
    slopes: bool = piece(
        "True to include in τ0 + τ1, from which the size u of the robust torque is computed, the acceleration that "
        "keeps s constant, as in the paper's eq. (45); False to leave it out, so that u is smaller",
        default=True,
        static=True,
    )

    def __check_init__(self) -> None:
        n = self.nominal.joints
        for part in (self.reaching, self.bound):
            require_joints(part, n, type(self.nominal).__name__)
        self.reaching.require_implicit()

    def reach_init(self) -> Memory:
        return ()

    def reach(self, moment: StepInput, plan: Plan, memory: Memory) -> ReachingStep:
        assert moment.horizon is not None
        feedforward = moment.reference.ddq
        # τ0 + τ1 with the slopes that an implicit step sees.
        if self.slopes:
            feedforward = feedforward + plan.holding_acceleration()
        tau_01 = matvec(moment.mass, feedforward) + moment.bias - self.reaching.continuous_term(plan.s)
        u = self.bound(moment.state, tau_01)
        s_next = self.reaching.implicit(moment.mass / moment.horizon, plan.s, u)
        return ReachingStep(s_next=s_next, memory=(), cover=u, signals={"u": u})


class TwistingStep(AbstractSurfaceStep):
    """Implicit step of super-twisting: `s⁺ = s + H (v⁺ - k1 sig^½(s⁺))`, `v⁺ = v - H k2 sgn(s⁺)`.

    The sign is set-valued, so that s⁺ stays 0 without chatter: s⁺ is 0 if `|s + H v| <= H² k2`; else `√|s⁺|` solves a
    quadratic equation. In one period the integral v moves by `-h k2 sat((s + H v)/(H² k2))`; it stops while the limits
    withhold torque. H is the plan's horizon, and `sig^½(s) = √|s| sgn(s)`.
    Source: Brogliato, Polyakov and Efimov, The implicit discretization of the supertwisting sliding-mode control
    algorithm, IEEE Transactions on Automatic Control 65, 2020.

    Signals: `s`, `s_next` (s⁺), `eps1`, `v` [n]; with a recovery `envelope_reset` [n], 1 where it acts.
    """

    k1: PerJoint = parameter("gain of the square root of s", "rad^½/s^(3/2) or m^½/s^(3/2)", "> 0")
    k2: PerJoint = parameter("gain of the integral of the sign of s", "rad/s³ or m/s³", "> 0")

    def reach_init(self) -> Vector:
        return jnp.zeros(self.nominal.joints)

    def reach(self, moment: StepInput, plan: Plan, memory: Vector) -> ReachingStep:
        horizon = moment.horizon
        assert horizon is not None
        target = plan.s + horizon * memory
        edge = horizon * horizon * self.k2
        beyond = jnp.maximum(jnp.abs(target) - edge, 0.0)
        damped = horizon * self.k1
        root = 2.0 * beyond / (damped + jnp.sqrt(damped * damped + 4.0 * beyond))
        share = jnp.clip(target / edge, -1.0, 1.0)
        return ReachingStep(
            s_next=jnp.sign(target) * root * root,
            memory=memory - moment.period * self.k2 * share,
            cover=None,
            signals={"v": memory},
        )
