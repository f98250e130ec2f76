"""What the sampled-data law remembers."""

from __future__ import annotations

import equinox as eqx
from jaxtyping import Array, Bool, Float

from slidax._types import Memory, Scalar, Vector
from slidax.estimators import Estimate

from .recovery import Reseat


class Kept(eqx.Module):
    """What the law keeps between two samples.

    - `t`: time of the last sample [s].
    - `sides`: what the transformation keeps.
    - `prior`: what the nominal model predicts for the next measurement.
    - `estimator`: what the estimator keeps.
    - `torques`: commands under way, the oldest first, [m n].
    - `s`, `dq`: sliding variable and velocity that are planned for the next sample, [n].
    - `eps`: the transformed error that the next plan may be near [n].
    - `last_eps`: the last plan's transformed error [n].
    - `planned`: whether that plan can be relied on.
    - `reseat`: envelopes in force in place of the drawn ones; None without a recovery.
    """

    t: Scalar
    sides: Memory
    prior: Estimate
    estimator: Memory
    torques: Float[Array, "m n"]
    s: Vector
    dq: Vector
    eps: Vector
    last_eps: Vector
    planned: Bool[Array, ""]
    reseat: Reseat | None
