"""Base class of discrete-time steps, with their input and their decision."""

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
    """Input of a step: the predicted arm when this sample's torque sets in.

    - `t`: that time [s].
    - `state`: positions and velocities.
    - `reference`: desired motion, with the mean acceleration over the following period.
    - `mass`: M0 [n n].
    - `bias`: C0 q̇ + G0 [n], N m or N.
    - `robot`: the arm of `mass` and `bias`, with the estimated parameters.
    - `limits`: of torque and torque rate.
    - `period`: h [s].
    - `horizon`: H [s]; None for a law without a plan.
    - `planned`: True if the last sample was one period ago, and no limit changed its torque.
    - `expected`: the velocity that it planned for now [n], rad/s or m/s.
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
    """Result of a step, before the disturbance compensation and the torque limits.

    - `tau`: torque [n], N m or N.
    - `acceleration`: of the nominal arm under it [n], rad/s² or m/s².
    - `memory`: after this sample.
    - `signals`: inner quantities by name.
    - `cover`: largest disturbance that is compensated, N m; None: only the torque limits bound it.
    - `limited`: the memory if the limits withhold torque, in which integrals of the error stop; None: as `memory`.
    """

    tau: Vector
    acceleration: Vector
    memory: Memory
    signals: dict[str, Array]
    cover: Scalar | None = None
    limited: Memory = None


class AbstractStep(AbstractPart):
    """A law in discrete time: from the predicted state to the torque that sets in there."""

    plans: ClassVar[bool]
    """True if it plans over a horizon."""

    @property
    @abstractmethod
    def robot(self) -> AbstractRobot:
        """The robot as the law knows it."""

    @abstractmethod
    def init(self, t: Scalar, state: State, reference: Reference, period: Scalar, horizon: Scalar | None) -> Memory:
        """Return the memory at the start.

        - `t`: time at the start [s].
        - `state`: measured positions and velocities.
        - `reference`: desired motion of the joints then.
        - `period`, `horizon`: h and H [s]; H is None for a law without a plan.
        """

    def restarted(self, t: Scalar, memory: Memory) -> Memory:
        """Return the memory after a jump of the clock or the sensor at time t [s], without dependence on the past."""
        return memory

    def recovers(self, t: Scalar, memory: Memory) -> Bool[Array, ""]:
        """True while a joint is on its way back into its envelope."""
        return jnp.zeros((), bool)

    @abstractmethod
    def __call__(self, moment: Moment, memory: Memory) -> Decision:
        """Return the torque, the resulting acceleration and the memory.

        - `moment`: the predicted arm.
        - `memory`: from `init` or the last sample.
        """

    @abstractmethod
    def envelope(self, t: Scalar, memory: Memory) -> Envelope | None:
        """Return the bounds that the error must keep at time t [s]; None for a law without an envelope."""
