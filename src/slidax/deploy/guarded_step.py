"""One step of a law as a robot runs it: never without a finite torque, and with a status that says what happened."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp

from slidax._errors import as_array
from slidax._types import Command, Envelope, Memory, Reference, Scalar, State, Vector
from slidax.actuators import TorqueLimits
from slidax.controllers import AbstractController, SampledData
from slidax.transformations import PrescribedPerformance

from .reads import read_by
from .status import (
    ENVELOPE_LEFT,
    MEASUREMENT_NOT_FINITE,
    MEASUREMENT_OUT_OF_RANGE,
    MISSED_PERIOD,
    PROMISE_VOID,
    REFERENCE_NOT_FINITE,
    TORQUE_LIMITED,
    TORQUE_NOT_FINITE,
    Condition,
)
from .step_memory import Flag, SensorRange, Status, StepMemory

Flags = dict[Condition, Flag]
"""What can be said of a sample or an answer, and whether it is so."""


class GuardedStep(AbstractController):
    """A controller behind its guards. It is a controller, too: what is exported can be simulated as it is.

    In this order: a bad measurement or reference, or a law without a finite answer, leaves the last command and all
    that is remembered as they are; a torque beyond the limits is limited. The law's own arithmetic is not touched.

    - `controller`: the law.
    - `range`: what a measurement can be.
    - `period`: time between two samples [s], > 0; None: the law's own, if it is a sampled-data law.
    - `limits`: of torque and torque rate; None: the law's own, likewise.
    - `reads`: what the law reads of a sample, such as `now.dq`: all else may be anything.

    Signals: those of the law, `rho` if it has an envelope, and `status`.
    """

    controller: AbstractController
    range: SensorRange
    period: Scalar | None
    limits: TorqueLimits | None
    reads: frozenset[str] = eqx.field(static=True)

    @staticmethod
    def around(controller: AbstractController, limits: TorqueLimits, period: float) -> GuardedStep:
        """The guards for a law; one that knows its period and limits shares them with its guards.

        - `controller`: the law.
        - `limits`: of torque and torque rate; each joint gets its own.
        - `period`: time between two samples [s].
        """
        n = controller.joints
        wide: TorqueLimits = jax.tree.map(lambda x: jnp.broadcast_to(x, (n,)), limits)
        reach = SensorRange(q=jnp.full(n, 1e6), dq=jnp.full(n, 1e6))
        reads = read_by(controller)
        if isinstance(controller, SampledData):
            return GuardedStep(eqx.tree_at(lambda law: law.limits, controller, wide), reach, None, None, reads)
        return GuardedStep(controller, reach, as_array(period), wide, reads)

    @property
    def joints(self) -> int:
        """The number of joints of the law."""
        return self.controller.joints

    def init(self, t: Scalar, state: State, reference: Reference) -> StepMemory:
        """What is kept before the first sample; all zeros, not started, if this measurement or reference is bad.

        - `t`: time at the start [s].
        - `state`: measured positions and velocities.
        - `reference`: what the joints should do then.
        """
        bad = self.checked(t, state, reference, reference)

        def begun() -> StepMemory:
            return self.begun(t, state, reference)

        held: StepMemory = jax.lax.cond(_status(bad) == 0, begun, lambda: _zeros(begun))
        return held

    def __call__(
        self, t: Scalar, state: State, reference_now: Reference, reference_next: Reference, memory: StepMemory
    ) -> Command:
        """The torque at one sample, finite whatever comes in; the status is one of its signals.

        - `t`: time [s].
        - `state`: measured positions and velocities.
        - `reference_now`, `reference_next`: what the joints should do now and one period later.
        - `memory`: what `init` or the last sample returned.
        """
        command, status = self.step(t, state, reference_now, reference_next, memory)
        signals = {**command.signals, "status": status.astype(float)}
        return Command(tau=command.tau, memory=command.memory, signals=signals)

    def step(
        self, t: Scalar, state: State, reference_now: Reference, reference_next: Reference, memory: StepMemory
    ) -> tuple[Command, Status]:
        """The torque at one sample, and the status; the first good sample starts the law.

        - `t`: time [s].
        - `state`: measured positions and velocities.
        - `reference_now`, `reference_next`: what the joints should do now and one period later.
        - `memory`: what `init` or the last sample returned; all zeros after a reset.
        """
        bad = _status(self.checked(t, state, reference_now, reference_next))
        begins = (bad == 0) & ~memory.started
        memory = jax.lax.cond(begins, lambda: self.begun(t, state, reference_now), lambda: memory)

        def answered() -> tuple[Command, Status]:
            command, flags = self.answered(t, state, reference_now, reference_next, memory)
            return command, _status(flags)

        def held() -> tuple[Command, Status]:
            tau = self.held(memory)
            kept = eqx.tree_at(lambda m: m.tau, memory, tau)
            # A law that a good sample cannot start has no answer.
            status = jnp.where(bad == 0, jnp.uint32(TORQUE_NOT_FINITE.bit), bad)
            return Command(tau=tau, memory=kept, signals=_zeros(answered)[0].signals), status

        answer: tuple[Command, Status] = jax.lax.cond((bad == 0) & memory.started, answered, held)
        return answer

    def checked(self, t: Scalar, state: State, reference_now: Reference, reference_next: Reference) -> Flags:
        """What is wrong with what comes in.

        - `t`: time [s].
        - `state`: measured positions and velocities.
        - `reference_now`, `reference_next`: what the joints should do now and one period later.
        """
        measured = [
            (getattr(state, part), getattr(self.range, part)) for part in ("q", "dq") if f"state.{part}" in self.reads
        ]
        wanted = [
            getattr(reference, part)
            for name, reference in (("now", reference_now), ("next", reference_next))
            for part in ("q", "dq", "ddq")
            if f"{name}.{part}" in self.reads
        ]
        beyond = [jnp.any(jnp.abs(value) > largest) for value, largest in measured]
        finite = _finite((t, [value for value, _ in measured]))
        return {
            MEASUREMENT_NOT_FINITE: ~finite,
            MEASUREMENT_OUT_OF_RANGE: finite & jnp.any(jnp.stack(beyond)),
            REFERENCE_NOT_FINITE: ~_finite(wanted),
        }

    def begun(self, t: Scalar, state: State, reference: Reference) -> StepMemory:
        """What is kept before the first sample, which is a good one; `started` is false if the law cannot keep it.

        - `t`: time at the start [s].
        - `state`: measured positions and velocities.
        - `reference`: what the joints should do then.
        """
        law = self.controller.init(t, state, reference)
        return StepMemory(
            started=_finite(law),
            commanded=jnp.zeros((), bool),
            t=t - self._period(),
            tau=jnp.zeros(self.joints),
            law=law,
        )

    def held(self, memory: StepMemory) -> Vector:
        """The last safe command [n], N m or N, within limits that may have been lowered since.

        - `memory`: what `init` or the last sample returned.
        """
        return self._within(memory.tau)

    def answered(
        self, t: Scalar, state: State, reference_now: Reference, reference_next: Reference, memory: StepMemory
    ) -> tuple[Command, Flags]:
        """The law's own command within the limits, or the last safe one if the law has no finite answer.

        - `t`: time [s].
        - `state`: measured positions and velocities.
        - `reference_now`, `reference_next`: what the joints should do now and one period later.
        - `memory`: of a law that has started.
        """
        period = self._period()
        command = self.controller(t, state, reference_now, reference_next, memory.law)
        law = command.memory_after(period)

        # What the drive held before the first command is not known, so that its rate is not limited.
        held = self.held(memory)
        last = jnp.where(memory.commanded, held, self._within(command.tau))
        tau = self._limits()(command.tau, last, period)
        limited = jnp.any(tau != command.tau)
        if isinstance(self.controller, SampledData):
            # It keeps the limits itself, and says so.
            limited = limited | ~command.memory.planned
        sound = _finite((command.tau, tau, law))

        envelope = self.controller.envelope(t, memory.law)
        e = state.q - self.wanted_then(reference_now)
        elapsed = t - memory.t
        flags = {
            TORQUE_NOT_FINITE: ~sound,
            ENVELOPE_LEFT: (
                jnp.zeros((), bool) if envelope is None else jnp.any((e <= envelope.lower) | (e >= envelope.upper))
            ),
            TORQUE_LIMITED: sound & limited,
            MISSED_PERIOD: (elapsed > 1.5 * period) | (elapsed <= 0),
            PROMISE_VOID: command.signals.get("assumption_violated", jnp.zeros(())) > 0,
        }
        kept = StepMemory(
            started=memory.started,
            commanded=memory.commanded | sound,
            t=jnp.where(sound, t, memory.t),
            tau=jnp.where(sound, tau, held),
            law=jax.tree.map(lambda new, old: jnp.where(sound, new, old), law, memory.law),
        )
        signals = command.signals
        decides = self.controller.step if isinstance(self.controller, SampledData) else self.controller
        transformation = getattr(decides, "transformation", None)
        if isinstance(transformation, PrescribedPerformance):
            signals = {**signals, "rho": transformation.performance.radius(t)}
        return Command(tau=kept.tau, memory=kept, signals=signals), flags

    def envelope(self, t: Scalar, memory: StepMemory) -> Envelope | None:
        """The law's envelope.

        - `t`: time [s].
        - `memory`: what `init` or a sample returned.
        """
        return self.controller.envelope(t, memory.law)

    def wanted_then(self, reference: Reference) -> Vector:
        """Where the joints should have been when they were measured [n], as far as the law knows how long ago that was.

        - `reference`: what they should do now.
        """
        law = self.controller
        if not isinstance(law, SampledData) or law.delay == law.dead_time:
            return reference.q
        return reference.q - (law.delay - law.dead_time) * law.period * reference.dq

    def _within(self, tau: Vector) -> Vector:
        largest = self._limits().torque
        # Not by `clip`: a limit that is NaN changes nothing.
        return jnp.where(tau > largest, largest, jnp.where(tau < -largest, -largest, tau))

    def _period(self) -> Scalar:
        if self.period is None:
            assert isinstance(self.controller, SampledData)
            return self.controller.period
        return self.period

    def _limits(self) -> TorqueLimits:
        if self.limits is None:
            assert isinstance(self.controller, SampledData)
            return self.controller.limits
        return self.limits


def _finite(tree: Memory) -> Flag:
    """Whether all numbers in it are."""
    flags = [jnp.all(jnp.isfinite(x)) for x in jax.tree.leaves(tree) if jnp.issubdtype(x.dtype, jnp.inexact)]
    return jnp.all(jnp.stack(flags)) if flags else jnp.ones((), bool)


def _status(flags: Flags) -> Status:
    """The bits of what is set."""
    status = jnp.uint32(0)
    for condition, is_set in flags.items():
        status = status | jnp.where(is_set, jnp.uint32(condition.bit), jnp.uint32(0))
    return status


def _zeros(function: Callable[[], Any]) -> Any:
    """Zeros in place of what a function returns."""
    return jax.tree.map(lambda x: jnp.zeros(x.shape, x.dtype), eqx.filter_eval_shape(function))
