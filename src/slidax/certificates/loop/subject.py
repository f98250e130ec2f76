"""The scenarios that `loop_rate` applies to, and their numbers that the bounds need."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from slidax._types import State
from slidax.controllers import SampledData
from slidax.controllers.steps import AbstractSurfaceStep, SlidingStep
from slidax.diagnosis.along import along
from slidax.diagnosis.linear_loop import LinearLoop
from slidax.diagnosis.loops import loops_of
from slidax.scenarios import Scenario
from slidax.transformations import PrescribedPerformance

Floats = NDArray[np.floating[Any]]


@dataclass(frozen=True)
class Subject:
    """A law with a plan, a linear estimator and an envelope, on its task.

    - `scenario`, `law`, `step`: whose.
    - `drawn`: the envelope.
    - `loops`: of the joints, near their goal.
    - `quiet`: whole periods from when something is measured to when it arrives; `dead_time`: the rest of the delay.
    """

    scenario: Scenario
    law: SampledData
    step: AbstractSurfaceStep
    drawn: PrescribedPerformance
    loops: tuple[LinearLoop, ...]
    quiet: int
    dead_time: float

    @classmethod
    def of(cls, scenario: Scenario) -> Subject | str:
        """The subject, or why there is none.

        - `scenario`: any.
        """
        found = lawful(scenario)
        if isinstance(found, str):
            return found
        law, step, loops = found
        if not isinstance(step.transformation, PrescribedPerformance):
            return "the scheme promises no envelope"
        sensor, actuator = scenario.description.sensor, scenario.description.actuator
        if sensor.jitter or sensor.loss.probability or sensor.loss.outages:
            return "samples that come at uneven times or get lost are not covered"
        if np.any(np.asarray(actuator.time_constant)):
            return "a drive with a lag of first order is not covered"
        true = sensor.delay + actuator.dead_time
        if abs(true - law.delay) > 1e-9:
            return f"the law believes a delay of {law.delay:g} periods, and it is {true:g}"
        if abs(sensor.delay - round(sensor.delay)) > 1e-9:
            return "measurements that are late by a part of a period are not covered"
        return cls(scenario, law, step, step.transformation, loops, round(sensor.delay), actuator.dead_time)

    @property
    def surface(self) -> Any:
        """The pull of the surface."""
        return self.step.surface

    def start(self) -> tuple[Floats, Floats, Floats]:
        """e, ė and the reference's acceleration at t = 0 [n]."""
        reference = self.scenario.trajectory.reference(jnp.zeros(()))
        state = self.scenario.state0
        e, de = np.asarray(state.q) - np.asarray(reference.q), np.asarray(state.dq) - np.asarray(reference.dq)
        return e, de, np.asarray(reference.ddq)

    def heavy(self, times: Floats) -> Floats:
        """The largest eigenvalue of the believed inertia along the reference [N], from 200 places of it.

        - `times`: [N], s.
        """
        grid = np.linspace(times[0], times[-1], min(times.size, 200))
        reference = jax.jit(jax.vmap(self.scenario.trajectory.reference))(jnp.asarray(grid))
        mass = along(self.law.nominal, np.asarray(reference.q), np.asarray(reference.dq))[0]
        if self.law.adaptation is not None:
            mass = np.array([np.asarray(self.law.adaptation.mass_at_start(jnp.asarray(one))) for one in mass])
        return np.interp(times, grid, np.linalg.eigvalsh(mass)[:, -1])

    def cover(self) -> tuple[float, float]:
        """The least u [N m], at rest at zero without torque, and s0; an infinite u where s⁺ does not depend on one."""
        if not isinstance(self.step, SlidingStep):
            return float("inf"), 0.0
        nothing = jnp.zeros(self.law.joints)
        u = float(self.step.bound(State(q=nothing, dq=nothing), nothing))
        layer = getattr(self.step.reaching, "layer", None)
        if layer is None:
            return 0.0, 1.0
        weights = np.min(np.asarray(getattr(self.step.reaching, "weights", 1.0)))
        return u * float(weights), float(np.max(np.asarray(layer)))


def lawful(scenario: Scenario) -> tuple[SampledData, AbstractSurfaceStep, tuple[LinearLoop, ...]] | str:
    """The law, its step and the loops of its joints; or why it has none that are linear.

    - `scenario`: any.
    """
    law = scenario.controller
    if not isinstance(law, SampledData):
        return "the scheme is not in sampled-data form"
    if not isinstance(law.step, AbstractSurfaceStep) or law.horizon is None:
        return "the law does not plan over a horizon"
    if scenario.description.sensor.instrument is not None:
        return "the sensor is not one of encoders"
    loops = loops_of(scenario)
    linear = tuple(loop for loop in loops if loop is not None)
    if len(linear) < len(loops):
        return f"the estimator `{type(law.estimator).__name__}` is not linear"
    return law, law.step, linear
