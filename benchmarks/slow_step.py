"""The same loop with one rule broken: a library solve instead of an unrolled one inside the scanned step."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax.numpy as jnp

from slidax import scenarios, simulate
from slidax.arms import AbstractRobot
from slidax.plant import AbstractDisturbance


class LibraryPlant(eqx.Module):
    """A plant as `slidax.Plant`, but for its solve.

    - `robot`: M, C, G.
    - `disturbance`: the forces from outside.
    - `sensor`, `actuator`: none.
    """

    robot: AbstractRobot
    disturbance: AbstractDisturbance
    sensor: None = None
    actuator: None = None

    def at(self, t: Any) -> AbstractRobot:
        """The robot, which carries nothing.

        - `t`: time [s].
        """
        return self.robot

    def acceleration(self, t: Any, state: Any, tau: Any) -> Any:
        """`M⁻¹ (τ + τ_d - C q̇ - G)` by `jnp.linalg.solve`.

        - `t`: time [s].
        - `state`: positions and velocities.
        - `tau`: torque of the controller.
        """
        force = tau + self.disturbance(t, state) - self.robot.bias(state.q, state.dq)
        return jnp.linalg.solve(self.robot.mass(state.q), force)


def contestant(changes: dict[str, Any], compile_s: dict[str, float]) -> Callable[[], float]:
    """A function that runs the loop a tenth as long and returns its nanoseconds per step.

    - `changes`: to the scenario example-4.1.
    - `compile_s`: where the time to compile is noted.
    """
    scenario = scenarios.load("example-4.1", changes)
    plant: Any = LibraryPlant(scenario.plant.robot, scenario.plant.disturbance)

    def run() -> Any:
        return simulate(
            plant,
            scenario.controller,
            scenario.trajectory,
            scenario.state0,
            t1=scenario.t1 / 10,
            period=scenario.period,
            integrator=scenario.stepping.integrator,
            log_every=None,
            engine="xla",
        )

    compile_s["slidax, xla, held, library solve in the step"] = run().timing.compile_s
    return lambda: run().timing.run_s / (scenario.t1 / 10 / scenario.period) * 1e9
