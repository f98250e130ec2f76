"""From a law in continuous time to its sampled-data form."""

from __future__ import annotations

from typing import Any

import jax.numpy as jnp

from slidax._errors import DefinitionError, as_array
from slidax.actuators import TorqueLimits
from slidax.estimators import AbstractEstimator, Measured
from slidax.numerics import vector_norm
from slidax.reaching import FixedBound, SaturatedReaching

from ..controller import AbstractController
from ..sliding_mode import SlidingMode
from ..slotine_li import SlotineLi
from .law import SampledData
from .recovery import Recovery

HORIZON = 0.012
"""The horizon unless another is asked for [s]: at 1 kHz long enough for a period of delay, rate limits and the noise of
encoders; docs/loop-rate.md shows the trade-off."""


def sampled_data(
    law: AbstractController,
    *,
    period: Any,
    horizon: Any = None,
    estimator: AbstractEstimator | None = None,
    limits: TorqueLimits | None = None,
    recovery: Recovery | None = None,
    delay: float = 0.0,
    dead_time: float = 0.0,
    slopes: bool = True,
) -> SampledData:
    """The implicit form of a law with a surface `s = ė + φ(t, e)`: same surface, envelope, reaching law and bound.

    - `law`: a `SlidingMode` (CFTSMPPC, FTSMPPC, FTSMC, SFSMC) or a `SlotineLi`, with an envelope or without.
    - `period`: h [s].
    - `horizon`: H [s], >= h; None: 12 ms, but no less than two periods.
    - `estimator`: from what is measured to q, q̇ and the unexplained acceleration; None: `Measured.critical` with the
      gain `min(.5, 2 h/H)`, for sensors that give the velocity.
    - `limits`: of torque and torque rate, as far as they are known; None for none.
    - `recovery`: what to do outside the envelope; None: pull back to the drawn one as it is.
    - `delay`: age of a measurement when its torque sets in, in periods.
    - `dead_time`: the part of it after the command, in periods.
    - `slopes`: whether u counts τ1's slopes, as (45) prints it; without them the arm is reached for with less torque.

    Raises DefinitionError if the law has no such surface, or something does not fit.
    """
    period = as_array(period)
    horizon = jnp.maximum(as_array(HORIZON), 2.0 * period) if horizon is None else as_array(horizon)
    if estimator is None:
        estimator = Measured.critical(jnp.minimum(0.5, 2.0 * period / horizon), delay + 1.0)
    common = {
        "estimator": estimator,
        "limits": TorqueLimits() if limits is None else limits,
        "recovery": recovery,
        "period": period,
        "horizon": horizon,
        "delay": delay,
        "dead_time": dead_time,
        "slopes": slopes,
    }
    if isinstance(law, SlidingMode):
        return SampledData(
            nominal=law.nominal,
            transformation=law.transformation,
            surface=law.surface,
            reaching=law.reaching,
            bound=law.bound,
            **common,
        )
    if isinstance(law, SlotineLi):
        gain = jnp.broadcast_to(law.gain, (law.joints,))
        size = vector_norm(gain)
        return SampledData(
            nominal=law.nominal,
            transformation=law.transformation,
            surface=law.surface,
            reaching=SaturatedReaching(law.damping, gain / jnp.where(size > 0, size, 1.0), law.layer),
            bound=FixedBound(size),
            **common,
        )
    raise DefinitionError(
        "only a law with a surface s = de + phi(t, e) has a sampled-data form: a SlidingMode or a SlotineLi; "
        f"got {type(law).__name__}"
    )
