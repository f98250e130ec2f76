"""Small signals that enter a closed loop from outside, at each place where one can."""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array

from slidax._types import Command, Envelope, Reference
from slidax.adaptation import KnownJoints
from slidax.controllers import AbstractController, SampledData
from slidax.disturbances import AbstractDisturbance
from slidax.parts import Memory, Scalar, State, Vector, piece
from slidax.sensors import AbstractSensor, Measurement
from slidax.simulation.loop import Loop
from slidax.trajectories import AbstractTrajectory

OF_THE_LAW = "command of the law"
"""The signal in which the torque of the law stands, before what is added to it."""


class Signals(eqx.Module):
    """Signals injected in one period, each [n].

    - `disturbance`: torque on the joints, held over the period, N m or N.
    - `torque`: added to the law's command, before the drives, N m or N.
    - `reference`, `reference_velocity`, `reference_acceleration`: added to what the joints should do.
    - `position`, `velocity`: added to the state that is measured.
    """

    disturbance: Vector
    torque: Vector
    reference: Vector
    reference_velocity: Vector
    reference_acceleration: Vector
    position: Vector
    velocity: Vector


class Pushed(AbstractDisturbance):
    """A disturbance with a constant torque beside it."""

    disturbance: AbstractDisturbance = piece("what there is")
    torque: Vector = piece("what is added")

    def __call__(self, t: Scalar, state: State) -> Vector:
        return self.disturbance(t, state) + self.torque

    def breakpoints(self) -> tuple[float, ...]:
        return self.disturbance.breakpoints()


class Nudged(AbstractController):
    """A law to whose command a torque is added, of which it does not know."""

    law: AbstractController = piece("the law")
    torque: Vector = piece("what is added")

    @property
    def joints(self) -> int:
        return self.law.joints

    def init(self, t: Scalar, state: State, reference: Reference) -> Memory:
        return self.law.init(t, state, reference)

    def __call__(
        self, t: Scalar, state: State, reference_now: Reference, reference_next: Reference, memory: Memory
    ) -> Command:
        command = self.law(t, state, reference_now, reference_next, memory)
        return Command(
            command.tau + self.torque, command.memory, {**command.signals, OF_THE_LAW: command.tau}, command.rate
        )

    def envelope(self, t: Scalar, memory: Memory) -> Envelope | None:
        return self.law.envelope(t, memory)


class Shifted(AbstractSensor):
    """A sensor before which something is added to the state; no sample is lost."""

    sensor: AbstractSensor = piece("what measures")
    position: Vector = piece("what is added to the positions")
    velocity: Vector = piece("what is added to the velocities")

    def init(self, state: State) -> Memory:
        return self.sensor.init(state)

    def __call__(self, k: Array, state: State, period: Scalar, memory: Memory) -> tuple[Measurement, Memory]:
        return self.sensor(k, State(q=state.q + self.position, dq=state.dq + self.velocity), period, memory)


class Offset(AbstractTrajectory):
    """A motion with something added to its position, velocity and acceleration, each by itself."""

    motion: AbstractTrajectory = piece("the motion")
    q: Vector = piece("what is added to the position")
    dq: Vector = piece("what is added to the velocity")
    ddq: Vector = piece("what is added to the acceleration")

    def position(self, t: Scalar) -> Vector:
        return self.motion.position(t) + self.q

    def reference(self, t: Scalar) -> Reference:
        reference = self.motion.reference(t)
        return Reference(q=reference.q + self.q, dq=reference.dq + self.dq, ddq=reference.ddq + self.ddq)


def injected(loop: Loop, signals: Signals) -> Loop:
    """The loop into which signals enter; its memories are those of the loop.

    - `loop`: the loop; with a sensor, if it is in held mode.
    - `signals`: what enters.
    """
    plant = eqx.tree_at(lambda p: p.disturbance, loop.plant, Pushed(loop.plant.disturbance, signals.disturbance))
    if plant.sensor is not None:
        plant = eqx.tree_at(lambda p: p.sensor, plant, Shifted(plant.sensor, signals.position, signals.velocity))
    motion = Offset(loop.trajectory, signals.reference, signals.reference_velocity, signals.reference_acceleration)
    law = Nudged(loop.controller, signals.torque)
    return eqx.tree_at(lambda x: (x.plant, x.trajectory, x.controller), loop, (plant, motion, law))


def standing(controller: AbstractController, memory: Memory) -> tuple[AbstractController, Memory]:
    """The law, which uses what it has learnt and learns no more, and its memory without what learning keeps.

    - `controller`: the law.
    - `memory`: what it keeps.
    """
    if not isinstance(controller, SampledData) or controller.adaptation is None:
        return controller, memory
    adaptation = controller.adaptation
    learnt = adaptation.learnt(memory.adapted.memory)
    known = KnownJoints(
        rotor=learnt.rotor, coulomb=learnt.coulomb, counted=adaptation.counted, smoothing=adaptation.smoothing
    )
    law: AbstractController = eqx.tree_at(lambda law: law.adaptation, controller, known)
    nothing = jnp.zeros_like(learnt.rotor)
    return law, eqx.tree_at(lambda kept: kept.adapted.memory, memory, nothing)
