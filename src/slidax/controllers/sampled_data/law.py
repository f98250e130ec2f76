"""The sampled-data law: the surface reached and followed by implicit steps, at the arm's own rate."""

from __future__ import annotations

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool

from slidax._errors import DefinitionError, as_array, known, require, require_joints, require_shape
from slidax._types import Command, Envelope, Matrix, Memory, Reference, Scalar, State, Vector
from slidax.actuators import TorqueLimits
from slidax.estimators import AbstractEstimator, Estimate
from slidax.numerics import matvec, nearest_in_box, once, solve_symmetric, vector_norm
from slidax.reaching import AbstractReaching
from slidax.robots import AbstractRobot
from slidax.surfaces import AbstractSurface
from slidax.transformations import AbstractTransformation, Frame

from ..controller import AbstractController
from .kept import Kept
from .plan import Barrier
from .prediction import commands_kept, free_acceleration, moved_on, predicted, reference_ahead
from .recovery import Recovery

FASTEST = 1e6
"""No arm is as fast, in rad/s or m/s; its cube bounds the estimated push. Whatever an estimator may come to, after
measurements that make no sense, the numbers after it stay finite."""

Bound = Callable[[State, Vector], Scalar]
"""u of (45), from the state and τ0 + τ1."""


class SampledData(AbstractController):
    """The law `s = ė + φ(t, e)` with (41)-(45) as one implicit Euler step over the horizon H, anew in every period h.

    With the led error `y = e + c ė`, `c = H - h/2`, its radius `ρ_y = ρ + c ρ̇` and `ρ_a = ρ_y + H ρ̇_y`:

    1. `A (s⁺ - s) = -K0 Sig^r(s⁺) - u N(s⁺)`, `A = M0/H`: the reaching step;
    2. `ρ_y ψ(ε) + H pull(ε) = y + H s⁺`: one ε for each joint;
    3. `v⁺ = (ρ_a ψ(ε) - y)/H`: the velocity error at the end of the horizon;
    4. `τ = M0 (q̈_r + (v⁺ - ė)/H - w) + C0 q̇ + G0`, `q̈_r = (q̇_d(t + h) - q̇_d(t))/h`.

    w is the acceleration that the nominal model does not explain, from the estimator. Without a disturbance y moves to
    `(1 - h/H) y + (h/H) ρ_a ψ(ε)` in one period, and e to a convex mean of itself and both y: so neither leaves the
    envelope (docs/sampled-data.md). Steps 1 and 2 have exactly one solution for every measurement, inside or outside.

    - `nominal`: the robot as the law knows it.
    - `transformation`, `surface`, `reaching`, `bound`: as in the printed law.
    - `estimator`: from what is measured to q, q̇ and w.
    - `limits`: torque and torque rate that the actuators keep.
    - `recovery`: what to do outside the envelope; None: pull back to the drawn one.
    - `period`: h [s], > 0.
    - `horizon`: H [s], >= h.
    - `delay`: age of a measurement when its torque sets in, in periods, >= 0: transport and dead time together.
    - `dead_time`: the part of it after the command, in periods.
    - `slopes`: whether u counts the slope part of τ1, as (45) prints it, or τ0 and K0's part alone.

    Signals: `s`, `s_next` (s⁺), `eps1`, `push` (w), `residual` (the acceleration that the last plan missed) [n], `u`;
    with a recovery `reseated` [n], 1 where its envelope is in force.

    Raises DefinitionError if one of them is out of its range or does not fit the joints.
    """

    nominal: AbstractRobot
    transformation: AbstractTransformation
    surface: AbstractSurface
    reaching: AbstractReaching
    bound: Bound
    estimator: AbstractEstimator
    limits: TorqueLimits
    recovery: Recovery | None
    period: Scalar = eqx.field(converter=as_array)
    horizon: Scalar = eqx.field(converter=as_array)
    delay: float = eqx.field(static=True, default=0.0)
    dead_time: float = eqx.field(static=True, default=0.0)
    slopes: bool = eqx.field(static=True, default=True)

    def __check_init__(self) -> None:
        for part in (self.transformation, self.surface, self.reaching, self.bound, self.limits):
            require_joints(part, self.joints, type(self.nominal).__name__)
        require_shape(self, (), "period", "horizon")
        require(self, "period", known(self.period) > 0, "must be > 0 s")
        require(self, "horizon", known(self.horizon) >= known(self.period), f"must be >= `period` = {self.period} s")
        require(self, "delay", known(self.delay) >= 0, "must be >= 0 periods")
        require(
            self, "dead_time", 0 <= known(self.dead_time) <= known(self.delay), "must be part of `delay`, from 0 to it"
        )
        # A reaching law that has no implicit step says so now, and not in the middle of a run.
        shapes = (jax.ShapeDtypeStruct(shape, float) for shape in ((self.joints, self.joints), (self.joints,), ()))
        eqx.filter_eval_shape(self.reaching.implicit, *shapes)
        self._require_an_estimator_of_these_joints()

    def _require_an_estimator_of_these_joints(self) -> None:
        state = State(q=jnp.zeros(self.joints), dq=jnp.zeros(self.joints))
        prior, number, flag = Estimate(state=state, push=state.q), jnp.zeros(()), jnp.zeros((), bool)
        try:
            estimate = eqx.filter_eval_shape(
                lambda estimator: estimator(state, prior, number, flag, estimator.init(state))[0], self.estimator
            )
            fits = all(leaf.shape == (self.joints,) for leaf in jax.tree.leaves(estimate))
        except (TypeError, ValueError):
            fits = False
        if not fits:
            raise DefinitionError(
                f"`{type(self.estimator).__name__}` does not fit the {self.joints} joints of "
                f"{type(self.nominal).__name__}: give one number, or one per joint"
            )

    @property
    def joints(self) -> int:
        """The number of joints of the nominal robot."""
        return self.nominal.joints

    def init(self, t: Scalar, state: State, reference: Reference) -> Memory:
        """The memory of an arm that is held by its own weight's torque.

        - `t`: time at the start [s].
        - `state`: measured positions and velocities.
        - `reference`: what the joints should do then.
        """
        e, de = state.q - reference.q, state.dq - reference.dq
        sides = self.transformation.init(t, e)
        zero = jnp.zeros(self.joints)
        held = self.nominal.bias(state.q, state.dq)
        lead, horizon = self._lead_and_horizon()
        eps = self.transformation.frame(t, lead, horizon, sides).transformed(e + lead * de)
        return Kept(
            t=t - self.period,
            sides=sides,
            prior=Estimate(state=state, push=zero),
            estimator=self.estimator.init(state),
            torques=jnp.broadcast_to(held, (commands_kept(self.delay), self.joints)),
            s=zero,
            dq=state.dq,
            eps=eps,
            last_eps=eps,
            planned=jnp.zeros((), bool),
            reseat=None if self.recovery is None else self.recovery.init(t, self.joints),
        )

    def __call__(
        self, t: Scalar, state: State, reference_now: Reference, reference_next: Reference, memory: Kept
    ) -> Command:
        """The torque, with the plan that led to it in the memory.

        - `t`: time [s].
        - `state`: measured positions and velocities.
        - `reference_now`, `reference_next`: what the joints should do now and one period later.
        - `memory`: what `init` or the last sample returned.
        """
        h = self.period
        lead, horizon = self._lead_and_horizon()
        elapsed = t - memory.t
        missed = elapsed > 1.5 * h
        prior = jax.lax.cond(missed, lambda: self._after_gap(memory, elapsed - h), lambda: memory.prior)
        estimate, estimator = self.estimator(state, prior, elapsed, missed, memory.estimator)
        estimate = _within_reason(estimate)
        push = estimate.push
        # While nothing arrived the last torque stood, so that it is the one that is under way.
        under_way = jnp.where(missed, memory.torques[-1], memory.torques)

        # The state at which this sample's torque sets in, and what will be measured next, as far as it is settled now.
        now, following = predicted(self.nominal, estimate, under_way, self.delay, h)
        t_set = t + self.dead_time * h
        desired = reference_ahead(reference_now, reference_next, self.dead_time, h)
        ddq_r = desired.ddq

        e, v = now.q - desired.q, now.dq - desired.dq
        y = e + lead * v
        m0 = once(self.nominal.mass(now.q))
        bias = self.nominal.bias(now.q, now.dq)
        frame = self.transformation.frame(t_set, lead, horizon, memory.sides)
        reseat, planned = memory.reseat, memory.planned & ~missed
        if self.recovery is not None and reseat is not None:
            drawn = self.transformation.envelope(t_set, memory.sides)
            if drawn is not None:
                reseat, fresh = self.recovery.reseat(t_set, e, v, drawn, self._slowness(m0, bias), lead, reseat)
                planned = planned & ~jnp.any(fresh)
                frame = self.recovery.frame(t_set, lead, horizon, frame, reseat)
        frame = once(frame)

        # What the last step planned, plus what the velocity missed: the position's slip is not multiplied by φ's slope.
        s, eps_guess = jax.lax.cond(
            planned,
            lambda: (memory.s + now.dq - memory.dq, memory.eps),
            lambda: self._measured(frame, y, v, horizon),
        )
        barrier = Barrier(frame, self.surface, horizon)
        place, place_slope = frame.place_and_slope(eps_guess)
        pull, pull_slope = self.surface.pull_and_slope(eps_guess)
        value, slope = frame.now * place + horizon * pull, frame.now * place_slope + horizon * pull_slope

        # τ0 + τ1 with the slopes that an implicit step sees: one Newton step of the plan that keeps s as it is.
        feedforward = ddq_r
        if self.slopes:
            kept_place = place + place_slope * (y + horizon * s - value) / slope
            feedforward = ddq_r + ((frame.ahead * kept_place - y) / horizon - v) / horizon
        tau_01 = matvec(m0, feedforward) + bias - self.reaching.power(s)
        u = self.bound(now, tau_01)

        s_next = self.reaching.implicit(m0 / horizon, s, u)
        eps = barrier.solve(y + horizon * s_next, eps_guess, (value, slope))
        v_next = (frame.ahead * frame.place_and_slope(eps)[0] - y) / horizon
        acceleration = ddq_r + (v_next - v) / horizon

        # The disturbance that is made up for is no larger than the one that u covers.
        lumped = matvec(m0, push)
        size = vector_norm(lumped)
        share = jnp.where(size > u, u / jnp.maximum(size, u), 1.0)
        push, lumped = share * push, share * lumped
        wanted = matvec(m0, acceleration) + bias - lumped
        tau, withheld, free = self._within_limits(wanted, memory.torques[-1], m0)

        moved = acceleration - withheld
        if following is None:
            following = moved_on(now, moved, (1.0 - self.delay % 1.0) * h)
        kept = Kept(
            t=jnp.asarray(t, memory.t.dtype),
            sides=memory.sides,
            prior=Estimate(state=following, push=push),
            estimator=estimator,
            torques=jnp.concatenate([under_way[1:], tau[None]]),
            s=s + (s_next - s) * (h / horizon),
            dq=now.dq + h * moved,
            # The line through the last two plans: from there most plans are one Newton step away.
            eps=jnp.where(planned, 2.0 * eps - memory.last_eps, eps),
            last_eps=eps,
            planned=free,
            reseat=reseat,
        )
        residual = jnp.where(planned, (now.dq - memory.dq) / h, 0.0)
        signals = {"s": s, "s_next": s_next, "eps1": eps, "push": push, "residual": residual, "u": u}
        if reseat is not None:
            signals["reseated"] = (t_set < reseat.until).astype(float)
        return Command(tau=tau, memory=kept, signals=signals)

    def envelope(self, t: Scalar, memory: Kept) -> Envelope | None:
        """The drawn envelope, whichever is in force.

        - `t`: time [s].
        - `memory`: what `init` or a sample returned.
        """
        return self.transformation.envelope(t, memory.sides)

    def _lead_and_horizon(self) -> tuple[Scalar, Scalar]:
        """`c = H - h/2` and H, s."""
        return self.horizon - 0.5 * self.period, self.horizon

    def _after_gap(self, memory: Kept, gap: Scalar) -> Estimate:
        """The prediction for the first measurement after lost samples, under the torque that was held meanwhile."""
        prior = memory.prior
        acceleration = free_acceleration(self.nominal, prior.state, memory.torques[-1]) + prior.push
        return Estimate(state=moved_on(prior.state, acceleration, gap), push=prior.push)

    def _measured(self, frame: Frame, y: Vector, v: Vector, horizon: Scalar) -> tuple[Vector, Vector]:
        """`s = ė + φ(t, y)` and ε as they are measured, with y held inside the frame."""
        eps = frame.transformed(y)
        drift = (frame.now - frame.ahead) / (horizon * frame.now)
        return v + drift * y + self.surface.pull_and_slope(eps)[0], eps

    def _within_limits(self, wanted: Vector, last: Vector, m0: Matrix) -> tuple[Vector, Vector, Bool[Array, ""]]:
        """The torque that the limits allow, the acceleration that they withhold, and whether they withhold none."""
        endless = jnp.full_like(wanted, jnp.inf)
        lower, upper = self.limits(-endless, last, self.period), self.limits(endless, last, self.period)
        free = jnp.all((wanted >= lower) & (wanted <= upper))

        def limited() -> tuple[Vector, Vector]:
            tau = nearest_in_box(wanted, lower, upper, m0)
            return tau, solve_symmetric(m0, wanted - tau)

        tau, withheld = jax.lax.cond(free, lambda: (wanted, jnp.zeros_like(wanted)), limited)
        return tau, withheld, free

    def _slowness(self, m0: Matrix, bias: Vector) -> Vector:
        """1/a, with the acceleration a that the limits leave each joint beside the arm's weight and coupled inertia."""
        limit = self.limits.torque
        slowness: Vector = jnp.sum(jnp.abs(m0), axis=1) / jnp.maximum(limit - jnp.abs(bias), 0.25 * limit)
        return slowness


def _within_reason(estimate: Estimate) -> Estimate:
    state = State(q=estimate.state.q, dq=jnp.clip(estimate.state.dq, -FASTEST, FASTEST))
    return Estimate(state=state, push=jnp.clip(estimate.push, -(FASTEST**3), FASTEST**3))
