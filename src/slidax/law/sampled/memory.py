"""Memory of a sampled-data law between two samples, and its model at one sample."""

from __future__ import annotations

from typing import NamedTuple

import equinox as eqx
from jaxtyping import Array, Bool, Float

from slidax.arms.arm import AbstractRobot
from slidax.core.types import Memory, Scalar, Vector

from ..estimators import Estimate
from .gate import GateMemory
from .monitor import MonitorMemory
from .prediction import AdaptationMemory


class LawMemory(eqx.Module):
    """Memory of a sampled-data law between two samples.

    - `t`: time of the last sample [s].
    - `prior`: the nominal model's prediction of the next measurement.
    - `estimator`: memory of the estimator.
    - `torques`: commands that have not acted yet, and earlier ones, the oldest first, [m n], N m or N.
    - `dq`: velocity that is planned for the next sample, [n], rad/s or m/s.
    - `planned`: True if this plan is valid, since no limit withheld any torque.
    - `step`: memory of the step.
    - `adapted`: memory of the adaptation; None without one.
    - `watched`: memory of the monitor; None without a monitor, or for a law without a plan.
    - `gate`: last accepted and last rejected measurements.
    - `accelerations`: planned accelerations of the nominal arm under the commands that have not acted yet, the oldest
      first, [d n]; None without `midpoint`, or without a delay.
    """

    t: Scalar
    prior: Estimate
    estimator: Memory
    torques: Float[Array, "m n"]
    dq: Vector
    planned: Bool[Array, ""]
    step: Memory
    gate: GateMemory
    adapted: AdaptationMemory | None = None
    watched: MonitorMemory | None = None
    accelerations: Float[Array, "d n"] | None = None


class LearnedModel(NamedTuple):
    """The arm as the law knows it at one sample.

    - `robot`: robot with the estimated parameters.
    - `estimate`: estimated state, and the disturbance with respect to this robot.
    - `net`: commands that have not acted yet, less the compensated friction, the oldest first, [k n], N m or N.
    - `adapted`: the adaptation's memory; None for a law that does not learn.
    - `settled`: True while the law uses the learnt model with its full weight.
    """

    robot: AbstractRobot
    estimate: Estimate
    net: Array
    adapted: AdaptationMemory | None
    settled: Bool[Array, ""]
