"""Warnings before a run: torque, inertia, estimator, robust torque and integration steps along the planned motion."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from slidax.arms.arm import AbstractRobot
from slidax.arms.articulated import Articulated
from slidax.core.errors import DefinitionError, span
from slidax.core.types import State
from slidax.law.joint_loop import LinearLoop
from slidax.law.sampled.controller import SampledData
from slidax.scenarios.scenario import Scenario
from slidax.simulation.plant import Plant

from .loop_causes import FAST, NOISY, SLOW, step_ratio
from .run_record import inertia_and_bias, joint_loops, require_explainable

SAMPLES = 200
"""Number of times at which the planned motion is checked."""

COMES = 0.02
"""Time after the pick-up of a payload at which the arm with payload is evaluated [s]."""


def forecast(scenario: Scenario) -> list[str]:
    """Likely reasons for a run to leave its envelope, one sentence each; empty for a scheme that cannot be diagnosed.

    It compares along the planned motion:

    - the required torque with the limits;
    - the eigenvalues κ of `M⁻¹ M0`, with the true inertia matrix M and the nominal M0, with each joint's stable range;
    - each estimator's bandwidth times the horizon with its useful range;
    - the robust torque with the model error;
    - the integrator's step with the longest stable one for the simulated friction.
    """
    try:
        law = require_explainable(scenario)
    except DefinitionError:
        return []
    planned = _PlannedMotion(scenario, law)
    return [*planned.torques(), *planned.inertias(), *planned.estimators(), *planned.cover(), *planned.steps()]


class _PlannedMotion:
    """The planned motion, and the true and the nominal arm along it. Its generators yield warnings."""

    def __init__(self, scenario: Scenario, law: SampledData) -> None:
        self.scenario, self.law = scenario, law
        own = scenario.plant
        self.plant: Plant = own if isinstance(own, Plant) else own.own
        self.nominal: AbstractRobot = self.law.nominal
        self.names = self.nominal.joint_names
        until = min(scenario.t1, float(np.nan_to_num(scenario.trajectory.until, posinf=scenario.t1)))
        self.t = np.linspace(0.0, max(until, scenario.period), SAMPLES)
        reference = jax.jit(jax.vmap(lambda t: scenario.trajectory.reference(t)))(jnp.asarray(self.t))
        self.q, self.dq, self.ddq = (np.asarray(values) for values in (reference.q, reference.dq, reference.ddq))

    @cached_property
    def believed(self) -> tuple[np.ndarray, np.ndarray]:
        """Nominal inertia matrix M0 and bias along the motion [samples n n], [samples n]."""
        return inertia_and_bias(self.nominal, self.q, self.dq)

    @cached_property
    def true(self) -> tuple[np.ndarray, np.ndarray]:
        """True inertia matrix M [samples n n], and bias with friction [samples n], with the payload while attached."""
        mass, bias = inertia_and_bias(self.plant.robot, self.q, self.dq)
        load = self.plant.load
        if load is not None:
            carried = (self.t >= float(load.attached)) & (self.t < float(load.released))
            loaded = eqx.filter_jit(lambda load, robot: load.on(robot, load.attached + COMES))(load, self.plant.robot)
            with_load = inertia_and_bias(loaded, self.q, self.dq)
            mass = np.where(carried[:, None, None], with_load[0], mass)
            bias = np.where(carried[:, None], with_load[1], bias)
        friction = np.asarray(jax.jit(jax.vmap(lambda dq: self.plant.robot.friction(dq)))(jnp.asarray(self.dq)))
        return mass, bias + friction

    @cached_property
    def external_torque(self) -> np.ndarray:
        """Torque of the scenario's disturbance along the motion [samples n], N m or N."""
        moving = State(q=jnp.asarray(self.q), dq=jnp.asarray(self.dq))
        return np.asarray(
            jax.jit(jax.vmap(lambda t, state: self.plant.disturbance(t, state)))(jnp.asarray(self.t), moving)
        )

    def torques(self) -> Iterator[str]:
        """Yield a warning if the motion needs more torque than a drive has."""
        mass, bias = self.true
        needed = np.einsum("kij,kj->ki", mass, self.ddq) + bias - self.external_torque
        limit = np.broadcast_to(np.asarray(self.law.limits.torque), self.law.joints)
        over = np.abs(needed) / limit
        k, joint = np.unravel_index(int(np.argmax(over)), over.shape)
        if over[k, joint] >= 1.0:
            unit = self.nominal.torque_units[joint]
            yield (
                f"the motion needs {abs(needed[k, joint]):.3g} {unit} at `{self.names[joint]}` at t = "
                f"{self.t[k]:.3g} s, but its limit is {limit[joint]:.4g} {unit}: go slower, carry less, or allow more "
                "torque"
            )

    def inertias(self) -> Iterator[str]:
        """Yield a warning if an eigenvalue κ of `M⁻¹ M0` is outside its loop's stable range.

        M and M0 are the true and the nominal inertia matrix. A law that learns the inertia gets no warning.
        """
        if not isinstance(self.nominal, Articulated) or self.law.adaptation is not None:
            return
        values, vectors = np.linalg.eig(np.linalg.solve(self.true[0], self.believed[0]))
        kappas, modes = np.real(values), np.argmax(np.abs(vectors), axis=1)
        worst = None
        for joint, loop in enumerate(self._loops):
            if loop is None:
                continue
            least, most = loop.stable_range()
            of_joint = kappas[modes == joint]
            if not of_joint.size or np.isnan(least):
                continue
            beyond = max(least / of_joint.min(), of_joint.max() / most)
            if beyond > 1.0 and (worst is None or beyond > worst[0]):
                worst = beyond, joint, of_joint.min(), of_joint.max(), least, most
        if worst is not None:
            _, joint, low, high, least, most = worst
            yield (
                f"κ, nominal over true inertia, is {span(low, high)} at `{self.names[joint]}`, but its loop is "
                f"stable only for {span(least, most)}: set the rotor inertias in `robot.nominal.armature`"
            )

    def estimators(self) -> Iterator[str]:
        """Yield a warning if the nominal loop is unstable, or an estimator is too slow or too fast for the horizon."""
        loops = [(joint, loop) for joint, loop in enumerate(self._loops) if loop is not None]
        if not loops or self.law.horizon is None:
            return
        joint, loop = max(loops, key=lambda pair: pair[1].radius())
        # A loop whose horizon has infinitely many periods has radius 1, up to rounding.
        if loop.radius() > 1.0 + 1e-9:
            yield (
                f"the loop of `{self.names[joint]}` is unstable with `{type(self.law.estimator).__name__}` even for "
                f"the nominal arm (spectral radius {loop.radius():.3f}): use the Kalman filter"
            )
            return
        if loop.measures_velocity:
            return
        paces = {joint: loop.bandwidth * float(self.law.horizon) for joint, loop in loops}
        slowest = min(paces, key=paces.__getitem__)
        if paces[slowest] < SLOW:
            yield (
                f"the estimator of `{self.names[slowest]}` has a bandwidth of {paces[slowest]:.2g}/H, too slow for "
                "the horizon H: raise `torque_density`, or use finer encoders or a longer `horizon`"
            )
        noises = {joint: self._noise(joint, loop) for joint, loop in loops if paces[joint] > FAST}
        loudest = max(noises, key=noises.__getitem__, default=None)
        if loudest is not None and noises[loudest] >= NOISY:
            yield (
                f"the estimator of `{self.names[loudest]}` has a bandwidth of {paces[loudest]:.2g}/H, with the "
                f"horizon H, so fast that noise alone causes torque steps of {noises[loudest]:.2g} times the rate "
                "limit: lower `torque_density`, or use finer encoders"
            )

    def _noise(self, joint: int, loop: LinearLoop) -> float:
        """Three standard deviations of the torque steps due to position noise, relative to the rate limit."""
        mass = jnp.asarray(self.believed[0].mean(axis=0))
        if self.law.adaptation is not None:
            mass = self.law.adaptation.mass_at_start(mass)
        variance = np.broadcast_to(np.asarray(self.scenario.description.sensor.variance()), self.law.joints)[joint]
        rate = np.broadcast_to(np.asarray(self.law.limits.rate), self.law.joints)[joint]
        step = loop.noise(float(variance))[1] * float(mass[joint, joint])
        return float(3.0 * step / (rate * float(self.law.period)))

    def cover(self) -> Iterator[str]:
        """Yield a warning if the robust torque u is smaller than the error of the model's torque."""
        bound = getattr(self.law.step, "bound", None)
        if bound is None:
            return
        difference = np.einsum("kij,kj->ki", self.true[0] - self.believed[0], self.ddq)
        missing = np.linalg.norm(difference + self.true[1] - self.believed[1] - self.external_torque, axis=1)
        feedforward = np.einsum("kij,kj->ki", self.believed[0], self.ddq) + self.believed[1]
        moving = State(q=jnp.asarray(self.q), dq=jnp.asarray(self.dq))
        u = np.asarray(jax.jit(jax.vmap(lambda state, tau: bound(state, tau)))(moving, jnp.asarray(feedforward)))
        k = int(np.argmax(missing / u))
        if missing[k] > u[k]:
            yield (
                f"the robust torque u covers {u[k]:.3g} N m at t = {self.t[k]:.3g} s, but the model error is "
                f"{missing[k]:.3g} N m there: "
                "enlarge `scheme.bound`, or improve the nominal arm"
            )

    def steps(self) -> Iterator[str]:
        """Yield a warning if the integrator's step is too long for the simulated friction."""
        ratio_and_joint = step_ratio(self.scenario)
        if ratio_and_joint is not None and ratio_and_joint[0] > 1.0:
            yield (
                f"a step of the integrator is {ratio_and_joint[0]:.2g} times too long for the simulated friction of "
                f"`{self.names[ratio_and_joint[1]]}`: raise `simulation.substeps`"
            )

    @cached_property
    def _loops(self) -> tuple[LinearLoop | None, ...]:
        return joint_loops(self.scenario)
