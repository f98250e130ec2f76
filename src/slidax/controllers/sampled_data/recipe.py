"""Make the sampled-data form of a law."""

from __future__ import annotations

from typing import Any

import jax.numpy as jnp

from slidax.actuators import TorqueLimits
from slidax.adaptation import AbstractAdaptation
from slidax.estimators import AbstractEstimator, Measured
from slidax.parts import DefinitionError, as_array

from ..controller import AbstractController
from ..steps import AbstractStep, Recovery
from .explicit_step import ExplicitStep
from .gate import MeasurementGate
from .law import SampledData
from .monitor import Monitor

HORIZON = 0.012
"""Default horizon [s]: at 1 kHz long enough for one period of delay, rate limits and encoder noise; docs/loop-rate.md
shows the trade-off."""


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
    adaptation: AbstractAdaptation | None = None,
    monitor: Monitor | None = None,
    gate: MeasurementGate | None = None,
) -> SampledData:
    """Make the sampled-data form of a law: with an estimator, a prediction over the delay, and torque limits.

    A law with a surface `s = ė + φ(t, e)` becomes an implicit step over a horizon: a `SlidingMode` (CFTSMPPC, FTSMPPC,
    FTSMC, SFSMC), a `SlotineLi` or a `SuperTwisting`, with an envelope or without. Any other law, such as
    `ComputedTorque`, is evaluated at the predicted state; the estimator adds a disturbance observer.

    - `law`: the law in continuous time.
    - `period`: h [s].
    - `horizon`: H [s], >= h, of an implicit step; None: 12 ms, but no less than two periods, nor than 1.5 (`delay` + 1)
      of them.
    - `estimator`: from measurements to q, q̇ and the unexplained acceleration; None: `Measured.tolerant` with the
      gain 2 h/H or less, for sensors that give the velocity.
    - `limits`: known limits of torque and torque rate; None for none.
    - `recovery`: policy of an implicit step outside the envelope; None: pull back to the prescribed envelope.
    - `delay`: age of a measurement when its torque sets in, in periods.
    - `dead_time`: the part of it after the command, in periods.
    - `slopes`: True if u counts the slopes of τ1, as printed in (45); without them u, and the torque, is smaller.
    - `adaptation`: adaptation law, such as `JointLearning.of_arm(...)`; None for none.
    - `monitor`: checks at every sample if the guarantee of the envelope still holds; None for none.
    - `gate`: rejects measurements that the arm cannot have produced; None: the gate for the nominal arm.

    Raises DefinitionError if an argument does not fit the law.
    """
    period = as_array(period)
    step: AbstractStep = law.implicit_step(recovery, slopes) or ExplicitStep(law)
    if horizon is not None and not step.plans:
        raise DefinitionError(f"`{type(law).__name__}` does not plan over a horizon; leave `horizon` out")
    least = max(2.0, 1.5 * (delay + 1.0)) * period
    horizon = jnp.maximum(as_array(HORIZON), least) if horizon is None else as_array(horizon)
    if estimator is None:
        estimator = Measured.tolerant(delay, 2.0 * period / horizon)
    return SampledData(
        step=step,
        estimator=estimator,
        limits=TorqueLimits() if limits is None else limits,
        period=period,
        horizon=horizon if step.plans else None,
        delay=delay,
        dead_time=dead_time,
        adaptation=adaptation,
        monitor=monitor,
        gate=MeasurementGate.of_arm(step.robot) if gate is None else gate,
    )
