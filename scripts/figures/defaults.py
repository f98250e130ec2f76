"""The table of default gains in docs/sampled-data.md: random arms that change in the middle of a run."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from slidax import scenarios
from slidax.arms import Articulated, Mismatch, Payload, TimedPayload
from slidax.core import Scalar, State, Vector
from slidax.law import SampledData
from slidax.plant import Step
from slidax.scenarios.scenario import Scenario
from slidax.simulation import Parts, Plant, Run, simulate_batch

from .shared import table, write_table

SCENARIOS = ("panda-payload", "ur5e-payload")
RATES = (50, 100, 250, 500, 1000)
DELAYS = (0, 1, 2, 3)
SENSORS: dict[str, dict[str, Any]] = {
    "encoders": {"resolution": 1e-5, "velocity": "differenced"},
    "velocity sensor": {"velocity": "measured"},
}
CHANGES = ("nothing", "half the torque", "2 kg grasped", "disturbance")

CHANGE, END, WINDOW = 3.0, 12.0, 3.0
"""Time of the change, end of the run, and length of its last windows [s]."""

WEIGHT = 20.0
"""rad/s²: about the acceleration of a wrist of 0.1 kg m² by 2 kg at 0.1 m from its axis."""

GROWTH = 2.0
"""An error grows if it is larger in the last window than in the one before by this factor."""

HEAVIEST, BEFORE_GRASP = 3.0, {"panda-payload": 1.0, "ur5e-payload": 3.0}
"""kg: largest payload, and largest one to which 2 kg are added; these arms are rated for 3 kg and 5 kg."""

SHARE_NEEDED = 0.4
"""Only a joint whose motion takes no more of its torque limit can lose half of its torque and still follow."""


class Weakened(Plant):
    """A plant whose drives deliver only a share of their torque from a time on."""

    share: Vector = eqx.field(kw_only=True)
    since: Scalar = eqx.field(kw_only=True)

    def acceleration(self, t: Scalar, state: State, tau: Vector) -> Vector:
        """The acceleration under the delivered torque [n], rad/s² or m/s².

        - `t`: time [s].
        - `tau`: torque of intact drives [n], N m or N.
        """
        return super().acceleration(t, state, jnp.where(t >= self.since, self.share * tau, tau))


@dataclass(frozen=True)
class Setting:
    """An arm with its default gains.

    - `scenario`: name of the built-in scenario that has the arm, its motion and its envelope.
    - `rate`: samples per second.
    - `sensor`: one of `SENSORS`.
    - `delay`: age of a measurement [periods].
    - `sampled_data`: settings of that block; empty for all defaults.
    """

    scenario: str
    rate: int
    sensor: str
    delay: float
    sampled_data: tuple[tuple[str, Any], ...] = ()

    def load(self) -> Scenario:
        """The scenario, with the default bound as well."""
        period = 1.0 / self.rate
        return scenarios.load(
            self.scenario,
            {
                "scheme.sampled_data": dict(self.sampled_data),
                "scheme.bound": {},
                "sensor": {**SENSORS[self.sensor], "delay": self.delay},
                "simulation.period": period,
                "simulation.substeps": max(2, round(period / 1e-3)),
                "simulation.t1": END,
            },
        )


def draw(scenario: Scenario, arms: int, seed: int, changes: tuple[str, ...] = CHANGES) -> dict[str, Array]:
    """Random arms, each with each change: masses, payload, friction, and the affected joint.

    - `scenario`: whose nominal arm and motion they have.
    """
    random = np.random.default_rng(seed)
    n = scenario.plant.robot.joints
    limit = np.broadcast_to(np.asarray(scenario.plant.actuator.limits.torque), (n,))
    rows = []
    for _ in range(arms):
        own = {
            "mass_factor": random.uniform(0.8, 1.2),
            "coulomb": random.uniform(0.1, 0.5, n),
            "viscous": random.uniform(0.05, 0.4, n),
        }
        filled, order, pushed, side = (
            random.uniform(),
            random.permutation(n),
            random.integers(n),
            random.choice([-1, 1]),
        )
        for change in changes:
            grasps = change == "2 kg grasped"
            row = own | {
                "payload": filled * (BEFORE_GRASP[scenario.name] if grasps else HEAVIEST),
                "grasped": 2.0 if grasps else 0.0,
                "share": np.ones(n),
                "disturbance": np.zeros(n),
            }
            if change == "half the torque":
                needed = _needed(scenario, row)
                row["share"][next(j for j in order if needed[j] < SHARE_NEEDED * limit[j])] = 0.5
            if change == "disturbance":
                row["disturbance"][pushed] = side * 0.3 * limit[pushed]
            rows.append(row)
    return {name: jnp.asarray(np.stack([row[name] for row in rows])) for name in rows[0]}


def simulated(setting: Setting, arms: int, seed: int, changes: tuple[str, ...] = CHANGES) -> Run:
    """The runs of a setting: each arm with each change in turn."""
    scenario = setting.load()

    def define(row: dict[str, Array]) -> Parts:
        _, controller, trajectory, start = scenario.parts
        return _plant(scenario, row), controller, trajectory, start

    every = max(1, round(0.004 * setting.rate))
    drawn = draw(scenario, arms, seed, changes)
    return simulate_batch(define, drawn, t1=END, stepping=scenario.stepping, log_every=every)


def largest_errors(run: Run) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Largest error of any joint [rad] in each of the last three windows, for each run; inf if not finite."""
    t, log = np.asarray(run.log.t)[0], run.log
    error = np.abs(np.asarray(log.state.q) - np.asarray(log.reference.q)).max(axis=-1)
    error = np.where(np.asarray(log.valid) & np.isfinite(error), error, np.inf)
    starts = [END - k * WINDOW for k in (3, 2, 1)]
    first, second, third = (error[:, (t >= start) & (t <= start + WINDOW)].max(axis=1) for start in starts)
    return first, second, third


def allowed_error(law: SampledData, final: float) -> float:
    """The final radius, and what the loop-rate rule adds for an unexplained acceleration of `WEIGHT` [rad].

    - `final`: ρ∞ of its envelope [rad].
    """
    return final + float(law.horizon + law.delay * law.period) ** 2 * WEIGHT


def diverging(setting: Setting, run: Run) -> np.ndarray:
    """True for each run that diverges.

    At the end of the run, 9 s after the change, its error is not finite, or larger than `allowed_error`, or grows: it
    is outside the final radius, `GROWTH` times that of the window before, and that one is larger than the one before
    it. One growing window is no sign: the motion's sinusoids beat, and the error with them.
    """
    scenario = setting.load()
    final = float(scenario.description.scheme.transformation.performance.final)
    first, before, last = largest_errors(run)
    grows = (last > GROWTH * before) & (before > first) & (last > final)
    return (last > allowed_error(scenario.controller, final)) | grows


def _plant(scenario: Scenario, row: dict[str, Any]) -> Weakened:
    own = scenario.plant
    center = jnp.array([0.0, 0.0, 0.1])
    mismatch = Mismatch(mass_factor=row["mass_factor"], coulomb=row["coulomb"], viscous=row["viscous"])
    nominal: Articulated = scenario.controller.nominal
    carrying = eqx.tree_at(
        lambda arm: arm.payload, mismatch.applied(nominal), Payload(row["payload"], center, 0.002 * row["payload"])
    )
    grasped = TimedPayload(Payload(row["grasped"], center, 0.002 * row["grasped"]), attached=CHANGE)
    disturbance = Step(row["disturbance"], CHANGE, CHANGE + 0.1)
    since = jnp.asarray(CHANGE)
    return Weakened(
        carrying, disturbance, own.sensor, own.actuator, grasped, share=jnp.asarray(row["share"]), since=since
    )


def _needed(scenario: Scenario, row: dict[str, Any]) -> np.ndarray:
    """Largest torque of the motion [n], N m or N."""
    times = jnp.linspace(2.0, END, 150)
    return np.asarray(_torques(_plant(scenario, row).robot, scenario.trajectory, times)).max(axis=0)


@eqx.filter_jit
def _torques(arm: Articulated, trajectory: Any, times: Array) -> Array:
    def at(t: Scalar) -> Vector:
        now = trajectory.reference(t)
        return jnp.abs(arm.mass(now.q) @ now.ddq + arm.bias(now.q, now.dq) + arm.friction(now.dq))

    return jax.vmap(at)(times)


ARMS_DRAWN = 10
SEED = 38


def write_defaults() -> None:
    """Write the table of default gains of docs/sampled-data.md, from 3200 runs."""
    rows = []
    for rate in RATES:
        for delay in DELAYS:
            row, count, horizon = [], 0, 0.0
            for sensor in SENSORS:
                largest = []
                for name in SCENARIOS:
                    setting = Setting(name, rate, sensor, delay)
                    run = simulated(setting, ARMS_DRAWN, SEED)
                    count += int(np.sum(diverging(setting, run)))
                    horizon = 1e3 * float(setting.load().controller.horizon)
                    largest.append(largest_errors(run)[2].reshape(ARMS_DRAWN, len(CHANGES)).max(axis=0))
                row += [f"{x:.1e}" for x in np.max(largest, axis=0)]
            rows.append([f"{rate}", f"{delay}", f"{horizon:.3g}", *row, f"{count}"])
    short = ("nothing", "half torque", "2 kg", "disturbance")
    head = ["rate [Hz]", "D", "H [ms]", *(f"{sensor}: {change}" for sensor in SENSORS for change in short), "diverge"]
    write_table("sampled-data.md", "defaults", table(head, rows))
