"""Memory of a sampled-data law."""

from __future__ import annotations

import equinox as eqx
from jaxtyping import Array, Bool, Float

from slidax.estimators import Estimate
from slidax.parts import Memory, Scalar, Vector

from .adapted import Adapted
from .gate import GateMemory
from .monitor import Watched


class Kept(eqx.Module):
    """Memory between two samples.

    - `t`: time of the last sample [s].
    - `prior`: the nominal model's prediction of the next measurement.
    - `estimator`: memory of the estimator.
    - `torques`: pending commands, the oldest first, [m n].
    - `dq`: velocity that is planned for the next sample, [n].
    - `planned`: True if that plan is valid: no limit withheld any torque.
    - `step`: memory of the step.
    - `adapted`: adaptation state; None without an adaptation.
    - `watched`: memory of the monitor; None without a monitor.
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
