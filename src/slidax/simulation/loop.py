"""A closed loop's two sides: what stays the same while time passes, and what changes."""

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
    """All that stays the same while time passes.

    - `plant`, `controller`, `trajectory`: the parts.
    - `period`: time between samples [s].
    - `last`: number of the last sample, N.
    - `windows`: from when each statistic counts.
    - `integrator`: one step of the plant.
    - `substeps`: steps of the plant per period, in held mode.
    - `continuous`: whether the law is evaluated at every stage of the integrator.
    - `recover`: whether the run goes on outside the envelope.
    - `tolerance`: what judges the run, whatever the scheme promises; None for nothing.
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
    """All that changes while time passes.

    - `k`: number of the next sample.
    - `state`: the state there.
    - `good`: the state at the last good sample.
    - `memory`: the controller's.
    - `tally`: what was counted.
    - `fault`: the first thing that went wrong.
    - `excursion`: where it was outside its envelope; None if that ends the run.
    - `sensor`, `actuator`: what those keep.
    - `torque`: the last command [n], which is held while samples are lost; None without a sensor.
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


class Passed(eqx.Module):
    """What one period leaves behind, beside the state: the memories of all parts that have one."""

    memory: Memory
    sensor: Memory
    actuator: Memory
    torque: Vector | None


Begun = tuple[Carry, Envelope | None, Reference, Float[Array, "*runs n"] | Float[np.ndarray, "*runs n"] | None]
"""The carry before the first sample, with the envelope and the reference there, and the torque that holds the arm [n],
N m or N; None without an actuator."""

Inside = Callable[[State, Envelope | None, Reference, Any], None]
"""Raises a DefinitionError if the first state may not be where it is, or cannot be held there."""
