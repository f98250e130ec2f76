"""Many closed loops at once, over a gain, by both engines. Run as `python -m benchmarks.batch`."""

from __future__ import annotations

import json
import os
import sys
import time
from collections.abc import Callable
from typing import Any

RUNS = 4096
STEPS = 2_000
ROUNDS = 5


def measure() -> dict[str, Any]:
    """Closed-loop steps per second of a batch of Example 4.1, held: most of all rounds, in turns."""
    import jax

    from benchmarks import machine

    jax.config.update("jax_enable_x64", True)
    machine.well_made_from_the_start()
    import equinox as eqx
    import jax.numpy as jnp

    from slidax import scenarios, simulate_batch
    from slidax.core import semi_implicit_euler

    scenario = scenarios.load("example-4.1")
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1

    def define(k1: Any) -> Any:
        controller = eqx.tree_at(lambda c: c.surface.k1, scenario.controller, k1)
        return scenario.plant, controller, scenario.trajectory, scenario.state0

    gains = jnp.linspace(0.1, 0.4, RUNS)

    def contestant(engine: Any, threads: int | None) -> Callable[[], float]:
        def run() -> float:
            started = time.perf_counter()
            done = simulate_batch(
                define,
                gains,
                t1=STEPS * scenario.period,
                period=scenario.period,
                integrator=semi_implicit_euler,
                engine=engine,
                threads=threads,
            )
            jax.block_until_ready(done.tally)
            return time.perf_counter() - started

        return run

    contestants = {"native, one core": contestant("native", 1)}
    if cores > 1:
        contestants[f"native, {cores} cores"] = contestant("native", None)
    contestants[f"xla, {cores} cores"] = contestant("xla", None)
    first = {name: run() for name, run in contestants.items()}
    times: dict[str, list[float]] = {name: [] for name in contestants}
    for _ in range(ROUNDS):
        for name, run in contestants.items():
            times[name].append(run())
    steps_per_s = {name: RUNS * STEPS / min(t) for name, t in times.items()}
    return {"runs": RUNS, "steps": STEPS, "steps_per_s": steps_per_s, "first_call_s": first}


if __name__ == "__main__":
    json.dump(measure(), sys.stdout)
