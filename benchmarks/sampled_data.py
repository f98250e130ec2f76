"""The sampled-data law beside the printed one: nanoseconds per closed-loop step, in turns on one core.

Run as a program of its own, `python -m benchmarks.sampled_data`, so that it can be bound to one core from the start.
"""

from __future__ import annotations

import json
import os
import statistics
import sys
from collections.abc import Callable
from typing import Any

ROUNDS = 8
STEPS = 50_000
PERIOD = 1e-4
JOINTS = (1, 2, 3, 5, 7)


def measure() -> dict[str, Any]:
    """Least and median time per step of each law on each arm, and the time to compile the default form."""
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
    import jax

    jax.config.update("jax_enable_x64", True)
    answer: dict[str, Any] = {}
    for arm, contestants in _arms().items():
        times: dict[str, list[float]] = {name: [] for name in contestants}
        for run in contestants.values():
            run()
        for _ in range(ROUNDS):
            for name, run in contestants.items():
                times[name].append(run())
        answer[arm] = {name: {"min": min(t), "median": statistics.median(t)} for name, t in times.items()}
    return answer


def _arms() -> dict[str, dict[str, Callable[[], float]]]:
    from benchmarks.chain import Chain
    from slidax import scenarios
    from slidax._types import State
    from slidax.controllers import cftsmppc
    from slidax.disturbances import Constant
    from slidax.performance import FixedTime
    from slidax.reaching import UncertaintyBound
    from slidax.simulation import Plant
    from slidax.trajectories import Sinusoid

    arms = {}
    for name in ("example-4.1", "example-4.2"):
        scenario = scenarios.load(name)
        arms[name] = _laws(scenario.plant, scenario.controller, scenario.trajectory, scenario.state0)
    for n in JOINTS:
        robot = Chain(n)
        law = cftsmppc(
            robot,
            performance=FixedTime(0.5, 0.002, 5.0, 2.01),
            overshoot=0.2,
            bound=UncertaintyBound(0.3, 1.0, 12.0, 2.2, 2.8, 1.0),
        )
        motion = Sinusoid([0.0] * n, [0.3] * n, 1.0, 0.0)
        reference = motion.reference(0.0)
        start = State(q=reference.q + 0.2, dq=reference.dq)
        plant = Plant(robot, Constant([0.5] * n))
        arms[f"chain of {n} joint{'s' if n > 1 else ''}"] = _laws(plant, law, motion, start)
    return arms


def _laws(plant: Any, printed: Any, motion: Any, start: Any) -> dict[str, Callable[[], float]]:
    import equinox as eqx
    import jax.numpy as jnp

    from slidax.actuators import TorqueLimits
    from slidax.controllers import Recovery, sampled_data

    sharp = eqx.tree_at(lambda law: law.reaching.layer, printed, jnp.asarray(0.0))
    limits = TorqueLimits(1e3, 1e9)
    laws = {
        "printed": printed,
        "sampled, s0 = 0": sampled_data(sharp, period=PERIOD),
        "sampled, s0 = .05": sampled_data(printed, period=PERIOD),
        "with limits, recovery and one period of delay predicted": sampled_data(
            sharp, period=PERIOD, limits=limits, recovery=Recovery(), delay=1.0
        ),
    }
    return {name: _contestant(plant, law, motion, start) for name, law in laws.items()}


def _contestant(plant: Any, law: Any, motion: Any, start: Any) -> Callable[[], float]:
    from slidax import simulate
    from slidax.numerics import semi_implicit_euler

    def run() -> float:
        finished = simulate(
            plant, law, motion, start, t1=STEPS * PERIOD, period=PERIOD, integrator=semi_implicit_euler, log_every=None
        )
        assert finished.timing is not None
        assert finished.outcome.ok, finished.outcome.message
        return finished.timing.run_s / STEPS * 1e9

    return run


if __name__ == "__main__":
    json.dump(measure(), sys.stdout)
