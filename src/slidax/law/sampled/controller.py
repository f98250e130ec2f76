"""The sampled-data form of a controller: estimation, prediction over the delay, and torque limits."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool

from slidax.arms.arm import AbstractRobot
from slidax.core.errors import DefinitionError, count_noun, require_joints
from slidax.core.linear_algebra import matvec, solve_symmetric
from slidax.core.parameter import parameter, piece
from slidax.core.tracing import barrier, select
from slidax.core.types import Command, Envelope, Memory, Reference, Scalar, State, Vector
from slidax.plant.actuators import ActuatorMap, TorqueLimits

from ..adaptation import AbstractAdaptation, LearnedParameters
from ..controllers import AbstractController
from ..estimators import AbstractEstimator, Estimate
from ..steps import AbstractStep, Decision, StepInput
from .gate import Admission, MeasurementGate
from .limits import compensated_share, within_limits
from .memory import LawMemory, LearnedModel
from .monitor import Monitor, MonitorMemory
from .prediction import (
    AdaptationMemory,
    Prediction,
    advance,
    commands_kept,
    experience_of,
    free_acceleration,
    left_unexplained,
    mean_past_torque,
    predict_state,
    predict_up_to,
    reference_ahead,
)

PAUSE = 0.3
"""s: longest pause of the learning while a joint is on its way back into its envelope."""

STRONGEST = 1e6
"""rad/s² or m/s²: largest estimated disturbance in the law; no drive could compensate more."""


class SampledData(AbstractController):
    """The sampled-data form of a law: once in each period it computes `τ = τ_step - M0 ŵ` within the torque limits.

    τ_step is the torque of the discrete-time `step`, M0 the nominal inertia matrix, and ŵ the estimated disturbance, an
    acceleration. With an adaptation M0 is the corrected M̂, and the learnt friction is compensated.

    1. The estimator corrects the nominal arm's prediction by the measurement, and estimates ŵ.
    2. The arm is predicted over the delay, under the commands that have not acted yet.
    3. The step computes a torque for the predicted state, and ŵ is compensated.
    4. Of all torques within the limits, the law returns the one whose accelerations are nearest to the desired ones.

    While samples are lost the last torque is held, and the next prediction accounts for it. A sample that the gate
    rejects counts as a lost one: only the gate's memory changes.

    With `midpoint` the torque is the inverse dynamics `M0(q_m) (u - ŵ) + C0 v_m + G0(q_m)` in the middle of its period,
    `q_m = q + h/2 q̇ + h²/8 u`, `v_m = q̇ + h/2 u`, for the acceleration u of the step at the predicted (q, q̇). The
    prediction over the delay then uses the accelerations that were planned, limits included.

    Signals: those of the step, `disturbance` (ŵ), `residual` (the acceleration that the last prediction missed) [n],
    and `rejected`, 1 for a sample that the gate did not accept, where all other signals are 0; with an adaptation
    its own, `rotor` (J) and `coulomb` (f) [n] at least; with a monitor `margin` and `assumption_violated`.
    """

    step: AbstractStep = piece("the law as a discrete-time step")
    estimator: AbstractEstimator = piece("computes q, q̇ and the disturbance ŵ from the measurements")
    limits: TorqueLimits = piece("torque and torque rate that the actuators keep")
    period: Scalar = parameter("h, time between two samples", "s", "> 0")
    horizon: Scalar | None = parameter(
        "H, time over which a step plans; None for a law without a plan", "s", ">= period", default=None
    )
    delay: float = parameter(
        "time from a measurement until its torque acts, transport and dead time together; with `actual_delay` its "
        "largest value",
        "periods",
        ">= 0",
        default=0.0,
        static=True,
    )
    actual_delay: Scalar | None = parameter(
        "present delay, which may be changed while the law runs; None for `delay`",
        "periods",
        "[dead_time, delay]",
        "since the law keeps the commands of `delay` periods",
        default=None,
    )
    dead_time: float = parameter(
        "part of `delay` after the command",
        "periods",
        "[0, delay]",
        "since it is part of `delay`",
        default=0.0,
        static=True,
    )

    adaptation: AbstractAdaptation | None = piece("adaptation law; None for none", default=None)
    monitor: Monitor | None = piece("checks if the guarantee of the envelope still holds; None for none", default=None)
    gate: MeasurementGate = piece(
        "rejects measurements that the arm cannot have produced", default_factory=MeasurementGate
    )
    midpoint: bool = piece(
        "True to evaluate the model in the middle of the torque's period, False at its start",
        default=False,
        static=True,
    )
    viscous_feedforward: bool = piece(
        "True to compensate the nominal arm's viscous friction at the reference's mean velocity in the period",
        default=False,
        static=True,
    )
    drives: ActuatorMap | None = piece("map from commands to joint torques; None if they are equal", default=None)

    def __check_init__(self) -> None:
        adaptation = None if self.adaptation is None else self.adaptation.per_joint()
        for part in (adaptation, self.limits, self.monitor, self.gate):
            require_joints(part, self.joints, type(self.nominal).__name__)
        if self.step.plans != (self.horizon is not None):
            wrong = "must be given for a law that plans" if self.step.plans else "must be None for a law without a plan"
            raise DefinitionError(f"`SampledData.horizon` {wrong}; got {self.horizon}")
        if self.monitor is not None and not self.step.plans and self.monitor.disturbance is None:
            raise DefinitionError(
                "`SampledData.monitor` follows a plan, and this law has none: set `disturbance` of the monitor, as "
                "`slidax admit` computes it, or leave the monitor out"
            )
        if self.viscous_feedforward and not hasattr(self.nominal, "viscous"):
            raise DefinitionError(
                f"`SampledData.viscous_feedforward` needs the viscous friction of the nominal arm, and "
                f"`{type(self.nominal).__name__}` has no `viscous`: leave it out, or describe the arm by its links"
            )
        if self.viscous_feedforward and self.adaptation is not None and self.adaptation.moves_bias:
            raise DefinitionError(
                f"`SampledData.viscous_feedforward` and `{type(self.adaptation).__name__}` both compensate viscous "
                "friction: leave `viscous_feedforward` out"
            )
        self._require_an_estimator_of_these_joints()

    def _require_an_estimator_of_these_joints(self) -> None:
        state = State(q=jnp.zeros(self.joints), dq=jnp.zeros(self.joints))
        prior, number, flag = Estimate(state=state, disturbance=state.q), jnp.zeros(()), jnp.zeros((), bool)
        try:
            estimate = eqx.filter_eval_shape(
                lambda estimator: estimator(state, prior, number, flag, estimator.init(state))[0], self.estimator
            )
            fits = all(leaf.shape == (self.joints,) for leaf in jax.tree.leaves(estimate))
        except (TypeError, ValueError):
            fits = False
        if not fits:
            raise DefinitionError(
                f"`{type(self.estimator).__name__}` does not fit the {count_noun(self.joints, 'joint')} of "
                f"{type(self.nominal).__name__}: each of its parameters must be one number, or one per joint"
            )

    @property
    def nominal(self) -> AbstractRobot:
        """The robot as the law knows it."""
        return self.step.robot

    @property
    def joints(self) -> int:
        return self.nominal.joints

    @property
    def believed_delay(self) -> float | Scalar:
        """Delay that the law assumes, from a measurement until its torque acts [periods]."""
        return self.delay if self.actual_delay is None else self.actual_delay

    def init(self, t: Scalar, state: State, reference: Reference) -> Memory:
        """Return the memory at the start; the earlier torques are assumed to be C0 q̇ + G0 at the measured state."""
        # A velocity that the estimator does not use may have any value.
        state = State(q=state.q, dq=jnp.clip(state.dq, -self.gate.speed, self.gate.speed))
        held = self.nominal.bias(state.q, state.dq)
        # The adaptation needs each torque until its effect has been measured.
        kept = commands_kept(self.delay) + (0 if self.adaptation is None else 2)
        pending = math.ceil(self.delay)
        return LawMemory(
            t=t - self.period,
            prior=Estimate(state=state, disturbance=jnp.zeros(self.joints)),
            estimator=self.estimator.init(state),
            torques=jnp.broadcast_to(held, (kept, self.joints)),
            dq=state.dq,
            planned=jnp.zeros((), bool),
            step=self.step.init(t, state, reference, self.period, self.horizon),
            adapted=None if self.adaptation is None else AdaptationMemory.init(self.adaptation, state, self.delay),
            watched=self._watched(state),
            gate=self.gate.init(t, state, self.estimator.reads_velocity),
            accelerations=jnp.zeros((pending, self.joints)) if self.midpoint and pending else None,
        )

    def __call__(
        self, t: Scalar, state: State, reference_now: Reference, reference_next: Reference, memory: LawMemory
    ) -> Command:
        command, accepted = self.gated(t, state, reference_now, reference_next, memory)
        held = jnp.clip(memory.torques[-1], -self.limits.torque, self.limits.torque)
        held = held if self.drives is None else self.drives.command(held)
        kept = select(accepted, command.memory, memory)
        signals = {name: jnp.where(accepted, value, 0.0) for name, value in command.signals.items()}
        return Command(
            tau=jnp.where(accepted, command.tau, held),
            memory=eqx.tree_at(lambda kept: kept.gate, kept, command.memory.gate),
            signals={**signals, "rejected": jnp.where(accepted, 0.0, 1.0)},
        )

    def gated(
        self, t: Scalar, state: State, reference_now: Reference, reference_next: Reference, memory: LawMemory
    ) -> tuple[Command, Bool[Array, ""]]:
        """Return the command, and True if the gate accepts the sample; otherwise only `memory.gate` in it is valid."""
        admission, gate = self.gate(
            t, state, memory.t, memory.prior.state.q, self.period, self.estimator.reads_velocity, memory.gate
        )
        accepted = admission.accepted
        # A rejected sample must not reach the arithmetic: gradients would see it even where its result is discarded.
        time = jnp.where(accepted, t, memory.t + self.period)
        measured = select(accepted, state, memory.prior.state)
        before = self._restart(time, measured, admission, memory)
        command = self._decide(time, measured, reference_now, reference_next, admission.restarts, before)
        return eqx.tree_at(lambda command: command.memory.gate, command, gate), accepted

    def _restart(self, t: Scalar, measured: State, admission: Admission, memory: LawMemory) -> LawMemory:
        """The memory after a restart by the gate; without one, the memory as it is."""
        state = State(q=measured.q, dq=admission.dq)
        anew = LawMemory(
            t=t - self.period,
            prior=Estimate(state=state, disturbance=memory.prior.disturbance),
            estimator=self.estimator.init(state),
            torques=memory.torques,
            dq=admission.dq,
            planned=memory.planned,
            step=self.step.restarted(t, memory.step),
            adapted=memory.adapted,
            watched=self._watched(state),
            gate=memory.gate,
            accelerations=memory.accelerations,
        )
        return select(admission.restarts, anew, memory)

    def _decide(
        self,
        t: Scalar,
        state: State,
        reference_now: Reference,
        reference_next: Reference,
        restarts: Bool[Array, ""],
        memory: LawMemory,
    ) -> Command:
        """Return the command for an accepted sample."""
        h = self.period
        elapsed = t - memory.t
        gap = elapsed > 1.5 * h
        missed = gap | restarts
        gap = gap & ~restarts
        robot = self._robot(memory.adapted)
        estimate, estimated, prior = self._estimate(robot, state, elapsed, missed, gap, memory)
        # The last torque stood while samples were lost, so that all pending commands are equal to it.
        pending = jnp.where(missed, memory.torques[-1], memory.torques)
        learned = self._learn(t, state, prior, estimate, reference_now, pending, missed, robot, memory)

        predicted = self._predict(learned, missed, memory)
        now, following = predicted.state, predicted.following
        request = self._step_input(t, now, reference_now, reference_next, missed, learned, memory)
        decision = self.step(request, memory.step)
        if self.midpoint:
            request, decision = self._at_midpoint(request, decision)

        wanted, disturbance, adapted = self._compensate(request, decision, learned.estimate, learned.adapted)
        tau, withheld, free = within_limits(wanted, memory.torques[-1], request.mass, self.limits, h)
        reached = decision.acceleration - withheld
        if following is None:
            following = advance(now, reached, (1.0 - self.delay % 1.0) * h)
        elif self.actual_delay is not None:
            following = advance(following, reached, jnp.clip(1.0 - self.actual_delay, 0.0, 1.0) * h)
        step = decision.memory
        if decision.limited is not None:
            step = jax.tree.map(lambda usual, limited: jnp.where(free, usual, limited), step, decision.limited)
        parameters = None if self.adaptation is None or adapted is None else self.adaptation.learnt(adapted.memory)
        accelerations = memory.accelerations
        if accelerations is not None:
            accelerations = jnp.stack([*predicted.accelerations[1:], reached - disturbance])
        unseen = state.q - learned.estimate.state.q
        watched, monitor_signals = self._monitor(request, unseen, decision, ~missed, parameters, disturbance, memory)
        kept = LawMemory(
            t=jnp.asarray(t, memory.t.dtype),
            prior=Estimate(state=following, disturbance=disturbance),
            estimator=estimated,
            torques=jnp.concatenate([pending[1:], tau[None]]),
            dq=now.dq + h * reached,
            planned=free,
            step=step,
            adapted=adapted,
            watched=watched,
            gate=memory.gate,
            accelerations=accelerations,
        )
        residual = jnp.where(request.planned, (now.dq - memory.dq) / h, 0.0)
        signals = {**decision.signals, "disturbance": disturbance, "residual": residual, **monitor_signals}
        if self.adaptation is not None and adapted is not None:
            signals |= self.adaptation.signals(adapted.memory)
        return Command(tau if self.drives is None else self.drives.command(tau), kept, signals)

    def _estimate(
        self,
        robot: AbstractRobot,
        state: State,
        elapsed: Scalar,
        missed: Bool[Array, ""],
        gap: Bool[Array, ""],
        memory: LawMemory,
    ) -> tuple[Estimate, Memory, Estimate]:
        """The estimate at this sample, the estimator's memory, and the prediction that the sample corrects."""
        prior = jax.lax.cond(gap, lambda: self._after_gap(robot, memory, elapsed - self.period), lambda: memory.prior)
        estimator = self.estimator
        if self.adaptation is not None and memory.adapted is not None:
            adapted = memory.adapted.memory
            estimator = estimator.for_inertia(self.adaptation.filter_inertia(robot, prior.state.q, adapted))
            estimator = estimator.with_share(self.adaptation.share(adapted))
        estimate, estimated = estimator(state, prior, elapsed, missed, memory.estimator)
        return self._within_reason(estimate), estimated, prior

    def _learn(
        self,
        t: Scalar,
        state: State,
        prior: Estimate,
        estimate: Estimate,
        reference: Reference,
        pending: Array,
        missed: Bool[Array, ""],
        robot: AbstractRobot,
        memory: LawMemory,
    ) -> LearnedModel:
        """Return the arm model after this sample; without an adaptation it does not change."""
        known = memory.adapted
        if self.adaptation is None or known is None:
            return LearnedModel(robot, estimate, pending, known, jnp.ones((), bool))
        h = self.period
        # During a recovery all joints accelerate at once, which disturbs the learning of each joint alone. A long
        # recovery does not pause it, since the arm may have changed.
        recovers = self.step.recovers(t, memory.step)
        recovering = jnp.where(recovers, known.recovering + h, 0.0)
        paused = recovers & (recovering <= PAUSE)
        surprised = ~self.gate.learnable(state, prior.state, h, self.estimator.reads_velocity)
        torque = mean_past_torque(pending, self.delay, self.actual_delay)
        experience = experience_of(self.nominal, state, estimate, torque, h, missed | surprised | paused)
        friction = jnp.where(missed, known.friction[-1], known.friction)
        net = pending[-friction.shape[0] :] - friction
        adapted = AdaptationMemory(self.adaptation(experience, known.memory), friction, recovering)
        # The disturbance is a torque: with another inertia it is another acceleration.
        at, revised = estimate.state, self._robot(adapted)
        if self.adaptation.moves_bias:
            before, after = (self.adaptation.friction(part.memory, reference.dq) for part in (known, adapted))
            changed = self.adaptation.changed_links(adapted.memory)
            lumped = left_unexplained(robot, revised, changed, estimate, reference) + after - before
        else:
            lumped = matvec(robot.mass(at.q), estimate.disturbance)
        explained = Estimate(at, solve_symmetric(revised.mass(at.q), lumped))
        return LearnedModel(revised, explained, net, adapted, self.adaptation.settled(adapted.memory))

    def _predict(self, learned: LearnedModel, missed: Bool[Array, ""], memory: LawMemory) -> Prediction:
        """The prediction over the delay."""

        def predicted(acceleration: Callable[[State, int], Vector]) -> Prediction:
            if self.actual_delay is None:
                return predict_state(learned.estimate, acceleration, self.delay, self.period)
            pending = math.ceil(self.delay)
            return predict_up_to(learned.estimate, acceleration, pending, self.actual_delay, self.period)

        def under_torques() -> Prediction:
            return predicted(lambda state, age: self._free_acceleration(learned.robot, state, learned.net[-age]))

        planned = memory.accelerations
        if planned is None:
            return under_torques()
        # After lost samples the last torque stood, for which no acceleration was planned.
        return jax.lax.cond(missed, under_torques, lambda: predicted(lambda _, age: planned[-age]))

    def _free_acceleration(self, robot: AbstractRobot, state: State, net: Vector) -> Vector:
        """The nominal arm's acceleration under a torque; with viscous friction where that is compensated."""
        return free_acceleration(robot, state, net - self._viscous(state.dq) if self.viscous_feedforward else net)

    def _viscous(self, dq: Vector) -> Vector:
        """The nominal arm's viscous friction [n], N m or N."""
        viscous: Vector = self.nominal.viscous  # type: ignore[attr-defined]
        return viscous * dq

    def _at_midpoint(self, request: StepInput, decision: Decision) -> tuple[StepInput, Decision]:
        """Recompute the model in the middle of the period, and with it the torque for the planned acceleration."""
        middle = advance(request.state, decision.acceleration, 0.5 * self.period)
        mass, bias = barrier(request.robot.mass(middle.q)), request.robot.bias(middle.q, middle.dq)
        tau = matvec(mass, decision.acceleration) + bias
        return replace(request, mass=mass, bias=bias), replace(decision, tau=tau)

    def _step_input(
        self,
        t: Scalar,
        now: State,
        reference_now: Reference,
        reference_next: Reference,
        missed: Bool[Array, ""],
        learned: LearnedModel,
        memory: LawMemory,
    ) -> StepInput:
        """The step's input at the time when its torque sets in."""
        robot = learned.robot
        m0, planned = barrier(robot.mass(now.q)), memory.planned & ~missed
        return StepInput(
            t=t + self.dead_time * self.period,
            state=now,
            reference=reference_ahead(reference_now, reference_next, self.dead_time, self.period),
            mass=m0,
            bias=robot.bias(now.q, now.dq),
            robot=robot,
            limits=self.limits,
            period=self.period,
            horizon=self.horizon,
            planned=planned,
            expected=memory.dq,
            disturbance=learned.estimate.disturbance,
            settled=learned.settled,
        )

    def _compensate(
        self, request: StepInput, decision: Decision, estimate: Estimate, adapted: AdaptationMemory | None
    ) -> tuple[Vector, Vector, AdaptationMemory | None]:
        """Return the torque before the limits, the compensated disturbance, and the memory with this friction."""
        lumped = matvec(request.mass, estimate.disturbance)
        share = compensated_share(lumped, decision.cover, self.limits)
        disturbance = share * estimate.disturbance
        wanted = decision.tau - share * lumped
        if self.viscous_feedforward:
            # `ddq` is the reference's mean acceleration over the period.
            wanted = wanted + self._viscous(request.reference.dq + 0.5 * self.period * request.reference.ddq)
        if self.adaptation is not None and adapted is not None:
            friction = self.adaptation.friction(adapted.memory, request.reference.dq)
            wanted = wanted + friction
            adapted = AdaptationMemory(
                adapted.memory, jnp.concatenate([adapted.friction[1:], friction[None]]), adapted.recovering
            )
        return wanted, disturbance, adapted

    def envelope(self, t: Scalar, memory: LawMemory) -> Envelope | None:
        return self.step.envelope(t, memory.step)

    def _watched(self, state: State) -> MonitorMemory | None:
        """Return the monitor's memory before the first sample; None without a monitor, or for a law without a plan."""
        return None if self.monitor is None or not self.step.plans else self.monitor.init(state)

    def _monitor(
        self,
        request: StepInput,
        unseen: Vector,
        decision: Decision,
        fresh: Bool[Array, ""],
        learnt: LearnedParameters | None,
        disturbance: Vector,
        memory: LawMemory,
    ) -> tuple[MonitorMemory | None, dict[str, Array]]:
        """The monitor's memory and signals."""
        if self.monitor is None:
            return None, {}
        if memory.watched is None:
            return None, self.monitor.without_plan(disturbance)
        envelope = None
        if self.horizon is not None:
            envelope = self.step.envelope(request.t + self.horizon - 0.5 * self.period, memory.step)
        if envelope is None or self.horizon is None:
            raise DefinitionError("`SampledData.monitor` watches an envelope, and this law has none: leave it out")
        desired = State(q=request.reference.q, dq=request.reference.dq)
        span, wanted = (self.period, self.horizon), decision.acceleration
        return self.monitor(
            request.state, unseen, desired, wanted, fresh, envelope, learnt, disturbance, span, memory.watched
        )

    def _robot(self, adapted: AdaptationMemory | None) -> AbstractRobot:
        """The arm with the estimated parameters."""
        if self.adaptation is None or adapted is None:
            return self.nominal
        return self.adaptation.robot(self.nominal, adapted.memory)

    def _after_gap(self, robot: AbstractRobot, memory: LawMemory, gap: Scalar) -> Estimate:
        """The prediction of the first measurement after lost samples, under the last torque."""
        prior, net = memory.prior, memory.torques[-1]
        if memory.adapted is not None:
            net = net - memory.adapted.friction[-1]
        acceleration = self._free_acceleration(robot, prior.state, net) + prior.disturbance
        return Estimate(state=advance(prior.state, acceleration, gap), disturbance=prior.disturbance)

    def _within_reason(self, estimate: Estimate) -> Estimate:
        """Return the estimate, bounded so that no gains of an estimator lead to infinite values."""
        state = State(q=estimate.state.q, dq=jnp.clip(estimate.state.dq, -self.gate.speed, self.gate.speed))
        return Estimate(state=state, disturbance=jnp.clip(estimate.disturbance, -STRONGEST, STRONGEST))
