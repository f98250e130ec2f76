"""The same loop with one rule broken: a library solve instead of an unrolled one inside the scanned step."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import jax.numpy as jnp

from slidax import scenarios, simulate
from slidax.core import Scalar, State, Vector
from slidax.simulation import Plant


class LibraryPlant(Plant):
    """A plant that solves for the acceleration by `jnp.linalg.solve`."""

    def acceleration(self, t: Scalar, state: State, tau: Vector) -> Vector:
        """`M⁻¹ (τ + τ_d - C q̇ - G)`, [n], rad/s² or m/s²; the arm has no friction and carries nothing."""
        force = tau + self.disturbance(t, state) - self.robot.bias(state.q, state.dq)
        return jnp.linalg.solve(self.robot.mass(state.q), force)


def contestant(changes: dict[str, Any], compile_s: dict[str, float]) -> Callable[[], float]:
    """A function that runs the loop a tenth as long and returns its nanoseconds per step.

    - `changes`: to the scenario example-4.1.
    - `compile_s`: where the time to compile is noted.
    """
    scenario = scenarios.load("example-4.1", changes)
    plant = LibraryPlant(scenario.plant.robot, scenario.plant.disturbance)

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
