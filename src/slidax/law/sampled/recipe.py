"""Make the sampled-data form of a controller; the explicit step for controllers without an implicit one."""

from __future__ import annotations

from typing import Any, ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from slidax.arms.arm import AbstractRobot
from slidax.core.errors import DefinitionError, as_array, is_traced
from slidax.core.linear_algebra import solve_symmetric
from slidax.core.parameter import piece
from slidax.core.types import Envelope, Memory, Reference, Scalar, State
from slidax.plant.actuators import TorqueLimits

from ..adaptation import AbstractAdaptation
from ..calm_step import Calm, CalmStep
from ..controllers import AbstractController
from ..estimators import AbstractEstimator, Measured
from ..implicit_steps import AbstractSurfaceStep
from ..steps import AbstractStep, Decision, Recovery, StepInput
from .controller import SampledData
from .gate import MeasurementGate
from .monitor import Monitor


class ExplicitStep(AbstractStep):
    """A printed law as a discrete-time step: `τ = law(t, q, q̇)` at the predicted q and q̇.

    The reference has its mean acceleration over the period. If the law returns a rate of its memory, the memory is
    integrated over the period, except while the limits withhold torque. Only the torque limits bound the compensated
    disturbance, since such a law has no robust torque u.

    Signals: those of the law.
    """

    law: AbstractController = piece("the law in its printed, continuous-time form")
    plans: ClassVar[bool] = False

    def __check_init__(self) -> None:
        if not isinstance(getattr(self.law, "nominal", None), AbstractRobot):
            raise DefinitionError(
                f"`{type(self.law).__name__}` has no `nominal` robot, which its sampled-data form needs to predict the "
                "arm: derive the law from `AbstractModelBased`"
            )

    @property
    def robot(self) -> AbstractRobot:
        return self.law.nominal  # type: ignore[attr-defined]

    def init(self, t: Scalar, state: State, reference: Reference, period: Scalar, horizon: Scalar | None) -> Memory:
        return self.law.init(t, state, reference)

    def __call__(self, moment: StepInput, memory: Memory) -> Decision:
        h, now = moment.period, moment.reference
        ahead = Reference(q=now.q + h * (now.dq + 0.5 * h * now.ddq), dq=now.dq + h * now.ddq, ddq=now.ddq)
        law = eqx.tree_at(lambda law: law.nominal, self.law, moment.robot)
        command = law(moment.t, moment.state, now, ahead, memory)
        return Decision(
            tau=command.tau,
            acceleration=solve_symmetric(moment.mass, command.tau - moment.bias),
            memory=command.memory_after(h),
            signals=command.signals,
            limited=None if command.rate is None else command.memory,
        )

    def envelope(self, t: Scalar, memory: Memory) -> Envelope | None:
        return self.law.envelope(t, memory)


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
    delay_at_most: float | None = None,
    dead_time: float = 0.0,
    slopes: bool = True,
    calm: Calm | None = None,
    adaptation: AbstractAdaptation | None = None,
    monitor: Monitor | None = None,
    gate: MeasurementGate | None = None,
    midpoint: bool = False,
    viscous_feedforward: bool = False,
) -> SampledData:
    """Return the sampled-data form of a law: with an estimator, a prediction over the delay, and torque limits.

    A law with a surface `s = ė + φ(t, e)` becomes an implicit step over a horizon: a `SlidingMode` (CFTSMPPC, FTSMPPC,
    FTSMC, SFSMC), a `SlotineLi` or a `SuperTwisting`, with an envelope or without. Any other law, such as
    `ComputedTorque`, is evaluated at the predicted state; the estimator adds a disturbance observer.

    - `law`: the law in continuous time.
    - `period`: h [s].
    - `horizon`: H [s], >= h, of an implicit step. None: 12 ms, but at least 2 and 1.5 (D + 1) periods, with the largest
      delay D.
    - `estimator`: estimates q, q̇ and the unexplained acceleration from measurements; None: `Measured.tolerant` with
      a gain of at most 2 h/H, for sensors that measure velocities.
    - `limits`: known limits of torque and torque rate; None for none.
    - `recovery`: policy of an implicit step outside the envelope; None: return to the prescribed envelope.
    - `delay`: time from a measurement until its torque acts, in periods.
    - `delay_at_most`: largest delay that can be set while the law runs, in periods; None: `delay` is fixed.
    - `dead_time`: part of `delay` after the command, in periods.
    - `slopes`: the size u of the robust torque grows with the law's other torque τ0 + τ1 (eq. (45) of the paper, see
      `SlidingMode`). True includes in τ0 + τ1 the torque that keeps the sliding variable s constant, as the paper does.
      False leaves this torque out, so that u is smaller.
    - `calm`: settings of calm steps, which change the torque least while the error is well inside its envelope; None
      for none.
    - `adaptation`: adaptation law, such as `JointLearning.of_arm(...)`; None for none.
    - `monitor`: checks at every sample if the guarantee of the envelope still holds; None for none.
    - `gate`: rejects measurements that the arm cannot have produced; None: the gate for the nominal arm.
    - `midpoint`: True to evaluate the model in the middle of the torque's period, False at its start.
    - `viscous_feedforward`: True to compensate the nominal arm's viscous friction at the reference's velocity.

    Raises DefinitionError if an argument does not fit the law.
    """
    period = as_array(period)
    if not is_traced(period) and not 0.0 < float(period) < np.inf:
        raise DefinitionError(f"`period` must be finite and > 0 s; got {float(period):g}")
    for name, periods in (("delay", delay), ("delay_at_most", delay_at_most)):
        if periods is not None and not is_traced(periods) and not 0.0 <= float(periods) < np.inf:
            raise DefinitionError(f"`{name}` must be finite and >= 0 periods; got {float(periods):g}")
    step: AbstractStep = law.implicit_step(recovery, slopes) or ExplicitStep(law.at_period(period))
    if calm is not None:
        if not isinstance(step, AbstractSurfaceStep):
            raise DefinitionError(
                f"`{type(law).__name__}` does not plan inside an envelope: leave `calm` out, or choose a scheme with "
                "an envelope, such as `cftsmppc`"
            )
        step = CalmStep(step, calm)
    if horizon is not None and not step.plans:
        raise DefinitionError(f"`{type(law).__name__}` does not plan over a horizon; leave `horizon` out")
    longest = delay if delay_at_most is None else delay_at_most
    least = max(2.0, 1.5 * (longest + 1.0)) * period
    horizon = jnp.maximum(as_array(HORIZON), least) if horizon is None else as_array(horizon)
    if estimator is None:
        estimator = Measured.tolerant(longest, 2.0 * period / horizon)
    return SampledData(
        step=step,
        estimator=estimator,
        limits=TorqueLimits() if limits is None else limits,
        period=period,
        horizon=horizon if step.plans else None,
        delay=longest,
        actual_delay=None if delay_at_most is None else as_array(delay),
        dead_time=dead_time,
        adaptation=adaptation,
        monitor=monitor,
        gate=MeasurementGate.of_arm(step.robot) if gate is None else gate,
        midpoint=midpoint,
        viscous_feedforward=viscous_feedforward,
    )


def class_of_law(controller: AbstractController) -> type:
    """Return the class of a law; for a sampled-data form, the class of the law or step that it evaluates."""
    step = getattr(controller, "step", controller)
    return type(getattr(step, "law", step))
