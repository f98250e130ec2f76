"""A closed loop: its constant parts, and its carry, which changes from sample to sample."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import equinox as eqx
import numpy as np
from jaxtyping import Array, Float, Int

from slidax._types import Envelope, Memory, Reference, Scalar, State, Vector
from slidax.controllers import AbstractController
from slidax.trajectories import AbstractTrajectory
from slidax.transformations import PrescribedPerformance

from .excursion import Excursion
from .outcome import Fault
from .plant import Plant
from .tally import Tally, Windows

Integrator = Callable[..., tuple[Any, tuple[Any, ...]]]


class Loop(eqx.Module):
    """The constant parts of a closed loop.

    - `period`: time between samples [s].
    - `last`: number of the last sample, N.
    - `windows`: first sample of each statistic.
    - `integrator`: one step of the plant.
    - `substeps`: steps of the plant per period, in held mode.
    - `continuous`: evaluate the law at every stage of the integrator.
    - `recover`: continue outside the envelope.
    - `tolerance`: band of the error that judges the run.
    """

    plant: Plant
    controller: AbstractController
    trajectory: AbstractTrajectory
    period: Scalar
    last: Int[Array, ""]
    windows: Windows
    integrator: Integrator = eqx.field(static=True)
    substeps: int = eqx.field(static=True)
    continuous: bool = eqx.field(static=True)
    recover: bool = eqx.field(static=True)
    tolerance: PrescribedPerformance | None = None


class Carry(eqx.Module):
    """The changing parts of a closed loop.

    - `k`: number of the next sample.
    - `state`: the true state there.
    - `good`: the state at the last good sample.
    - `memory`, `sensor`, `actuator`: memories of the controller, the sensor and the actuator.
    - `fault`: the first fault.
    - `excursion`: samples outside the envelope; None if the first of them ends the run.
    - `torque`: the last command [n], held while samples are lost; None without a sensor.
    """

    k: Int[Array, ""]
    state: State
    good: State
    memory: Memory
    tally: Tally
    fault: Fault
    excursion: Excursion | None
    sensor: Memory
    actuator: Memory
    torque: Vector | None


class Memories(eqx.Module):
    """The memories of all parts after a period, and the held torque, as in `Carry`."""

    memory: Memory
    sensor: Memory
    actuator: Memory
    torque: Vector | None


LoopStart = tuple[Carry, Envelope | None, Reference, Float[Array, "*runs n"] | Float[np.ndarray, "*runs n"] | None]
"""A carry, with the envelope and the reference at t = 0, and the torque that holds the arm there [n], N m or N (None
without an actuator)."""
