"""Scenarios with a bound at the sampling rate: law, linear loops, delays and sensor noise."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from slidax.analysis.run_record import inertia_and_bias, joint_loops
from slidax.core.types import State
from slidax.law.error_transformations import PrescribedPerformance
from slidax.law.implicit_steps import AbstractSurfaceStep, SlidingStep
from slidax.law.joint_loop import LinearLoop
from slidax.law.sampled.controller import SampledData
from slidax.scenarios.scenario import Scenario

from ..sampled_scenario import Floats


@dataclass(frozen=True)
class LoopProblem:
    """A scenario's law with a plan, a linear estimator and an envelope.

    - `drawn`: the envelope.
    - `loops`: of the joints, linearised near their goal.
    - `quiet`: whole periods from a measurement to its arrival; `dead_time`: the rest of the delay, in periods.
    """

    scenario: Scenario
    law: SampledData
    step: AbstractSurfaceStep
    drawn: PrescribedPerformance
    loops: tuple[LinearLoop, ...]
    quiet: int
    dead_time: float

    @classmethod
    def of(cls, scenario: Scenario) -> LoopProblem | str:
        """The problem, or the reason why the certificate does not apply."""
        problem = linear_loops(scenario)
        if isinstance(problem, str):
            return problem
        law, step, loops = problem
        if not isinstance(step.transformation, PrescribedPerformance):
            return "the scheme has no envelope"
        sensor, actuator = scenario.description.sensor, scenario.description.actuator
        if sensor.jitter or sensor.loss.probability or sensor.loss.outages:
            return "jitter and lost samples are not covered"
        if np.any(np.asarray(actuator.time_constant)):
            return "a drive with a first-order lag is not covered"
        timing = scenario.description.timing
        true = timing.total_delay
        if abs(true - law.delay) > 1e-9:
            return f"the law assumes a delay of {law.delay:g} periods, and the true delay is {true:g}"
        if abs(timing.delay - round(timing.delay)) > 1e-9:
            return "measurements delayed by a fraction of a period are not covered"
        return cls(scenario, law, step, step.transformation, loops, round(timing.delay), timing.dead_time)

    @property
    def surface(self) -> Any:
        return self.step.surface

    def start(self) -> tuple[Floats, Floats, Floats]:
        """e, ė and the reference's acceleration at t = 0 [n]."""
        reference = self.scenario.trajectory.reference(jnp.zeros(()))
        state = self.scenario.state0
        e, de = np.asarray(state.q) - np.asarray(reference.q), np.asarray(state.dq) - np.asarray(reference.dq)
        return e, de, np.asarray(reference.ddq)

    def heavy(self, times: Floats) -> Floats:
        """The largest eigenvalue of the nominal inertia along the reference [N], interpolated between 200 points."""
        grid = np.linspace(times[0], times[-1], min(times.size, 200))
        reference = jax.jit(jax.vmap(self.scenario.trajectory.reference))(jnp.asarray(grid))
        mass = inertia_and_bias(self.law.nominal, np.asarray(reference.q), np.asarray(reference.dq))[0]
        if self.law.adaptation is not None:
            mass = np.array([np.asarray(self.law.adaptation.mass_at_start(jnp.asarray(matrix))) for matrix in mass])
        return np.interp(times, grid, np.linalg.eigvalsh(mass)[:, -1])

    def cover(self) -> tuple[float, float]:
        """The least u [N m], at rest at zero without torque, and s0; an infinite u if s⁺ does not depend on one."""
        if not isinstance(self.step, SlidingStep):
            return float("inf"), 0.0
        nothing = jnp.zeros(self.law.joints)
        u = float(self.step.bound(State(q=nothing, dq=nothing), nothing))
        layer = getattr(self.step.reaching, "layer", None)
        if layer is None:
            return 0.0, 1.0
        weights = np.min(np.asarray(getattr(self.step.reaching, "weights", 1.0)))
        return u * float(weights), float(np.max(np.asarray(layer)))


def linear_loops(scenario: Scenario) -> tuple[SampledData, AbstractSurfaceStep, tuple[LinearLoop, ...]] | str:
    """Return the law, its step and its linear joint loops; or the reason why it has none."""
    law = scenario.controller
    if not isinstance(law, SampledData):
        return "the scheme is not in sampled-data form"
    if not isinstance(law.step, AbstractSurfaceStep) or law.horizon is None:
        return "the law does not plan over a horizon"
    if law.midpoint or law.viscous_feedforward:
        return "the law evaluates its model at mid-period, or compensates viscous friction"
    if scenario.description.sensor.instrument is not None:
        return "the sensor is no encoder"
    loops = joint_loops(scenario)
    linear = tuple(loop for loop in loops if loop is not None)
    if len(linear) < len(loops):
        return f"the estimator `{type(law.estimator).__name__}` is not linear"
    return law, law.step, linear


@dataclass(frozen=True)
class SensorNoise:
    """Noise of a measured position and velocity, each joint; rad or m, and rad/s or m/s.

    - `position`: rounding bound, r/2 [n].
    - `position_deviation`, `velocity_deviation`: σ of the normal noise [n].
    """

    position: Floats
    position_deviation: Floats
    velocity_deviation: Floats

    @classmethod
    def of(cls, scenario: Scenario, joints: int) -> SensorNoise:
        """The noise of a scenario's encoders."""
        sensor = scenario.description.sensor
        levels = (sensor.resolution, sensor.position_noise, sensor.velocity_noise)
        resolution, position, velocity = (np.broadcast_to(np.asarray(level, float), joints) for level in levels)
        return cls(0.5 * resolution, position, velocity)

    @property
    def random(self) -> bool:
        """True if some noise is unbounded."""
        return bool(np.any(self.position_deviation) or np.any(self.velocity_deviation))

    def size(self, period: float, sums: Floats, squares: Floats, times: int, chance: float) -> Floats:
        """Bound of the noise's effect on each output at all times, except with a probability `chance` [7 n j].

        `r/2 Σ|g| + λ √(σ_q² Σ g_q² + σ_v² Σ g_v²)`, `λ = √(2 ln(2 times/chance))`: the first term always holds, the
        second because a sum of independent normal numbers is normal, and by a union bound over the times.

        - `period`: h [s].
        - `sums`, `squares`: of the responses' sizes, to positions and velocities in units of periods [2 7 n j].
        - `times`: number of samples, joints and outputs.
        """
        spread = np.sqrt(
            (self.position_deviation**2)[None, :, None] * squares[0]
            + ((period * self.velocity_deviation) ** 2)[None, :, None] * squares[1]
        )
        return self.position[None, :, None] * sums[0] + self.deviations(times, chance) * spread

    def start(self, period: float, times: int, chance: float) -> tuple[Floats, Floats]:
        """Noise of the first measurement alone: position [n], rad or m, and velocity [n], rad or m per period."""
        factor = self.deviations(times, chance)
        return self.position + factor * self.position_deviation, factor * period * self.velocity_deviation

    def deviations(self, times: int, chance: float) -> float:
        """λ: number of standard deviations that no sample exceeds, except with a probability `chance`."""
        return math.sqrt(2.0 * math.log(2.0 * times / chance)) if self.random else 0.0
