"""What every step is: what it uses, and what it decides."""

from __future__ import annotations

from abc import abstractmethod
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool

from slidax._types import Envelope, Reference
from slidax.actuators import TorqueLimits
from slidax.parts import AbstractPart, Matrix, Memory, Scalar, State, Vector
from slidax.robots import AbstractRobot


class Moment(eqx.Module):
    """What a step uses: the arm when this sample's torque sets in, as predicted.

    - `t`: that time [s].
    - `state`: positions and velocities.
    - `reference`: what the joints should do, with the mean acceleration over the period from there.
    - `mass`: M0 [n n].
    - `bias`: C0 q̇ + G0 [n], N m or N.
    - `robot`: the arm that these are of, as it is believed to be.
    - `limits`: of torque and torque rate.
    - `period`: h [s].
    - `horizon`: H [s]; None for a law that decides for one period.
    - `planned`: whether the last sample was one period ago, and its torque was the wanted one.
    - `expected`: the velocity that was planned then for now [n], rad/s or m/s.
    """

    t: Scalar
    state: State
    reference: Reference
    mass: Matrix
    bias: Vector
    robot: AbstractRobot
    limits: TorqueLimits
    period: Scalar
    horizon: Scalar | None
    planned: Bool[Array, ""]
    expected: Vector


class Decision(eqx.Module):
    """What a step wants, before the estimated push is compensated and the limits are kept.

    - `tau`: torque [n], N m or N.
    - `acceleration`: of the nominal arm under it [n], rad/s² or m/s².
    - `memory`: after this sample.
    - `signals`: inner quantities by name.
    - `cover`: the largest push that is compensated, N m; None: as much as the drives can give.
    - `limited`: the memory where the limits withhold some of the torque: what integrates an error then stands still,
      since the error is no longer its own; None: as `memory`.
    """

    tau: Vector
    acceleration: Vector
    memory: Memory
    signals: dict[str, Array]
    cover: Scalar | None = None
    limited: Memory = None


class AbstractStep(AbstractPart):
    """A law in discrete time: from the state in which its torque will set in to that torque."""

    plans: ClassVar[bool]
    """Whether it plans over a horizon."""

    @property
    @abstractmethod
    def robot(self) -> AbstractRobot:
        """The robot as the law knows it."""

    @abstractmethod
    def init(self, t: Scalar, state: State, reference: Reference, period: Scalar, horizon: Scalar | None) -> Memory:
        """The memory at the start.

        - `t`: time at the start [s].
        - `state`: measured positions and velocities.
        - `reference`: what the joints should do then.
        - `period`: h [s].
        - `horizon`: H [s]; None for a law that decides for one period.
        """

    def restarted(self, t: Scalar, memory: Memory) -> Memory:
        """The memory after a jump of the clock or of the sensor: all that does not depend on the past is kept.

        - `t`: time of the sample that restarts the law [s].
        - `memory`: what `init` or the last sample returned.
        """
        return memory

    def recovers(self, t: Scalar, memory: Memory) -> Bool[Array, ""]:
        """True while a joint is on its way back into its envelope.

        - `t`: time [s].
        - `memory`: what `init` or the last sample returned.
        """
        return jnp.zeros((), bool)

    @abstractmethod
    def __call__(self, moment: Moment, memory: Memory) -> Decision:
        """The torque, the motion that it leads to, and the memory.

        - `moment`: the arm as it is predicted.
        - `memory`: what `init` or the last sample returned.
        """

    @abstractmethod
    def envelope(self, t: Scalar, memory: Memory) -> Envelope | None:
        """The bounds that the error must keep, or None for a law that promises none.

        - `t`: time [s].
        - `memory`: what `init` or a sample returned.
        """
