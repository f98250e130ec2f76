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
    """What enters in one period, each [n].

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
        """The sum, [n], N m or N.

        - `t`: time [s].
        - `state`: positions and velocities.
        """
        return self.disturbance(t, state) + self.torque

    def breakpoints(self) -> tuple[float, ...]:
        """Those of what there is."""
        return self.disturbance.breakpoints()


class Nudged(AbstractController):
    """A law to whose command a torque is added, of which it does not know."""

    law: AbstractController = piece("the law")
    torque: Vector = piece("what is added")

    @property
    def joints(self) -> int:
        """The number of joints it commands."""
        return self.law.joints

    def init(self, t: Scalar, state: State, reference: Reference) -> Memory:
        """The law's own memory.

        - `t`: time at the start [s].
        - `state`: measured positions and velocities.
        - `reference`: what the joints should do then.
        """
        return self.law.init(t, state, reference)

    def __call__(
        self, t: Scalar, state: State, reference_now: Reference, reference_next: Reference, memory: Memory
    ) -> Command:
        """The law's command and the torque.

        - `t`: time [s].
        - `state`: measured positions and velocities.
        - `reference_now`, `reference_next`: what the joints should do now and one period later.
        - `memory`: of the law.
        """
        said = self.law(t, state, reference_now, reference_next, memory)
        return Command(said.tau + self.torque, said.memory, {**said.signals, OF_THE_LAW: said.tau}, said.rate)

    def envelope(self, t: Scalar, memory: Memory) -> Envelope | None:
        """The law's own.

        - `t`: time [s].
        - `memory`: of the law.
        """
        return self.law.envelope(t, memory)


class Shifted(AbstractSensor):
    """A sensor before which something is added to the state; no sample is lost."""

    sensor: AbstractSensor = piece("what measures")
    position: Vector = piece("what is added to the positions")
    velocity: Vector = piece("what is added to the velocities")

    def init(self, state: State) -> Memory:
        """The sensor's own memory.

        - `state`: true positions and velocities at sample 0.
        """
        return self.sensor.init(state)

    def __call__(self, k: Array, state: State, period: Scalar, memory: Memory) -> tuple[Measurement, Memory]:
        """What is measured.

        - `k`: number of the sample.
        - `state`: true positions and velocities at it.
        - `period`: time between two samples [s].
        - `memory`: of the sensor.
        """
        return self.sensor(k, State(q=state.q + self.position, dq=state.dq + self.velocity), period, memory)


class Offset(AbstractTrajectory):
    """A motion with something added to its position, velocity and acceleration, each by itself."""

    motion: AbstractTrajectory = piece("the motion")
    q: Vector = piece("what is added to the position")
    dq: Vector = piece("what is added to the velocity")
    ddq: Vector = piece("what is added to the acceleration")

    def position(self, t: Scalar) -> Vector:
        """The position, [n], rad or m.

        - `t`: time [s].
        """
        return self.motion.position(t) + self.q

    def reference(self, t: Scalar) -> Reference:
        """The reference at a time.

        - `t`: time [s].
        """
        one = self.motion.reference(t)
        return Reference(q=one.q + self.q, dq=one.dq + self.dq, ddq=one.ddq + self.ddq)


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
