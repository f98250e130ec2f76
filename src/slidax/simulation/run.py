"""What a simulation returns."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple, TypeAlias

import equinox as eqx
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from slidax._types import Envelope, Reference, Scalar, State

from .excursion import Excursion
from .free_body import FreeBody
from .outcome import Fault, Outcome, describe
from .tally import Tally, Windows

Anyhow: TypeAlias = Array | np.ndarray
"""An array of JAX inside a transformation, of NumPy in a finished run."""


class Log(eqx.Module):
    """Logged samples; every array has the sample as its first axis.

    - `k`: number of the sample.
    - `t`: time [s].
    - `state`: the true one, whatever a sensor says of it.
    - `reference`, `envelope`: as the controller saw them; `envelope` is None for a scheme without one.
    - `tau`: torque that is set [N m or N]: within the limits of an actuator, and the last one where a sample was lost.
    - `signals`: the controller's inner quantities by name; where a sample was lost, those of the answer not taken.
    - `valid`: False for places after the end of the run, which only a batch has.
    """

    k: Int[Anyhow, "..."]
    t: Float[Anyhow, "..."]
    state: State
    reference: Reference
    tau: Float[Anyhow, "..."]
    signals: Mapping[str, Float[Anyhow, "..."]]
    envelope: Envelope | None
    valid: Bool[Anyhow, "..."]

    @property
    def e(self) -> Float[Anyhow, "..."]:
        """Error `q - q_d`, rad or m."""
        return self.state.q - self.reference.q

    @property
    def de(self) -> Float[Anyhow, "..."]:
        """Velocity error `q̇ - q̇_d`, rad/s or m/s."""
        return self.state.dq - self.reference.dq


class Timing(NamedTuple):
    """Where the time of a run went.

    - `compile_s`: tracing and compiling [s]; near 0 for the second run of the same shape.
    - `run_s`: the run itself [s].
    """

    compile_s: float
    run_s: float


class Run(eqx.Module):
    """A finished simulation.

    - `log`: the logged samples, or None if none were asked for.
    - `tally`: statistics of all samples, which the metrics read.
    - `windows`: from when each statistic counts, and the settling bands.
    - `fault`: the first thing that went wrong, as arrays; see `outcome`.
    - `excursion`: where it was outside its envelope, as arrays; None if that ends a run.
    - `state`: the state at the last good sample.
    - `period`: time between samples [s].
    - `t1`: end that was asked for [s].
    - `joint_units`: unit of each joint's position.
    - `joint_names`: what the joints are called.
    - `has_envelope`: whether the scheme promises one.
    - `timing`: seconds spent; None inside a transformation.
    - `load`: where the load was, once it was let go; None where nothing is, or if the robot is not MuJoCo's.
    """

    log: Log | None
    tally: Tally
    windows: Windows
    fault: Fault
    excursion: Excursion | None
    state: State
    period: Scalar
    t1: Scalar
    joint_units: tuple[str, ...] = eqx.field(static=True)
    joint_names: tuple[str, ...] = eqx.field(static=True)
    has_envelope: bool = eqx.field(static=True)
    timing: Timing | None = eqx.field(static=True, default=None)
    load: FreeBody | None = None

    @property
    def joints(self) -> int:
        """The number of joints."""
        return len(self.joint_units)

    @property
    def torque_units(self) -> tuple[str, ...]:
        """Unit of each joint's torque: "N m" for a revolute joint, "N" for a prismatic one."""
        return tuple("N m" if unit == "rad" else "N" for unit in self.joint_units)

    @property
    def outcome(self) -> Outcome:
        """How the run ended; needs known values, so not inside `vmap`: look at `fault` there."""
        return describe(self.fault, self.excursion, int(self.tally.violations), float(self.period), self.joint_units)
