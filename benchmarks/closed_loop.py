"""One closed loop, Example 4.1, against hand-written C and a NumPy loop, all in turns on one core.

Run as a program of its own, `python -m benchmarks.closed_loop`, so that it can be bound to one core from the start.
"""

from __future__ import annotations

import json
import os
import statistics
import sys
import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

ROUNDS = 12
STEPS = 100_000
PERIOD = 1e-4


def measure() -> dict[str, Any]:
    """Nanoseconds per step of each contestant, least and median over the rounds, and the time to compile."""
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
    import jax

    jax.config.update("jax_enable_x64", True)
    from benchmarks import c_program, numpy_loop, slow_step

    held = {"simulation.mode": "held", "simulation.integrator": "semi_implicit_euler"}
    compile_s: dict[str, float] = {}
    with tempfile.TemporaryDirectory() as folder:
        contestants: dict[str, Callable[[], float]] = {
            f"slidax, {engine}, {name}": _slidax(f"slidax, {engine}, {name}", engine, changes, log_every, compile_s)
            for name, changes, log_every in (
                ("held", held, None),
                ("held, every sample logged", held, 1),
                ("continuous (RK4)", {}, None),
            )
            for engine in ("native", "xla")
        }
        contestants["slidax, xla, held, library solve in the step"] = slow_step.contestant(held, compile_s)
        program = c_program.compiled(Path(folder))
        for mode in ("held", "continuous"):
            contestants[f"example_4_1.c, {mode}"] = partial(
                c_program.nanoseconds_per_step, program, mode, STEPS, PERIOD
            )
        times: dict[str, list[float]] = {name: [] for name in contestants}
        for _ in range(ROUNDS):
            for name, contestant in contestants.items():
                times[name].append(contestant())
    times["NumPy loop, held"] = [numpy_loop.run(steps=STEPS // 10, period=PERIOD)["ns_per_step"] for _ in range(3)]
    return {
        "ns_per_step": {name: {"min": min(t), "median": statistics.median(t)} for name, t in times.items()},
        "compile_s": compile_s,
    }


def _slidax(
    name: str, engine: str, changes: dict[str, Any], log_every: int | None, compile_s: dict[str, float]
) -> Callable[[], float]:
    from slidax import scenarios

    scenario = scenarios.load("example-4.1", {**changes, "simulation.engine": engine})
    timing = scenario.simulate(log_every=log_every).timing
    assert timing is not None
    compile_s[name] = timing.compile_s

    def run() -> float:
        timing = scenario.simulate(log_every=log_every).timing
        assert timing is not None
        return timing.run_s / STEPS * 1e9

    return run


if __name__ == "__main__":
    json.dump(measure(), sys.stdout)
