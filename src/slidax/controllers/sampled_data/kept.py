"""The memory of a law in sampled-data form."""

from __future__ import annotations

import equinox as eqx
from jaxtyping import Array, Bool, Float

from slidax.estimators import Estimate
from slidax.parts import Memory, Scalar, Vector

from .adapted import Adapted
from .gate import GateMemory
from .monitor import Watched


class Kept(eqx.Module):
    """What the law keeps between two samples.

    - `t`: time of the last sample [s].
    - `prior`: what the nominal model predicts for the next measurement.
    - `estimator`: what the estimator keeps.
    - `torques`: commands under way, the oldest first, [m n].
    - `dq`: velocity that is planned for the next sample, [n].
    - `planned`: whether that plan can be relied on: no limit withheld any torque.
    - `step`: what the step keeps.
    - `adapted`: what is kept of the adaptation; None without one.
    - `watched`: what is kept by the monitor; None without one.
    - `gate`: last accepted and last rejected measurements.
    """

    t: Scalar
    prior: Estimate
    estimator: Memory
    torques: Float[Array, "m n"]
    dq: Vector
    planned: Bool[Array, ""]
    step: Memory
    gate: GateMemory
    adapted: Adapted | None = None
    watched: Watched | None = None
