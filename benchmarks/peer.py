"""The same laws and loops in slidax and in OpenSMC, in turns on one core. Run as `python -m benchmarks.peer`.

The joint and the laws are those of tests/peers/test_opensmc.py, which shows that both programs compute the same
samples. Both hold the torque over a period, move the plant by a Runge-Kutta step, and keep every sample.
"""

from __future__ import annotations

import json
import os
import statistics
import sys
import time
from importlib.metadata import version
from typing import Any

ROUNDS = 7
STEPS = 20_000
PERIOD = 1e-4
LAWS = ("boundary_layer", "fixed_time", "nonsingular_fast_terminal")


def measure() -> dict[str, Any]:
    """Nanoseconds per step of either program for each law, least and median over the rounds.

    The time of slidax is that of the whole call, with its checks and its log, but without tracing and compiling, which
    are given for themselves: for the first call, and for a later one, which finds the compiled loop again.
    """
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
    import jax

    jax.config.update("jax_enable_x64", True)
    from tests.peers.test_opensmc import PAIRS, by_opensmc, by_slidax

    def opensmc(name: str) -> float:
        started = time.perf_counter()
        by_opensmc(PAIRS[name], PERIOD, STEPS)
        return time.perf_counter() - started

    def slidax(name: str, log_every: int | None) -> float:
        started = time.perf_counter()
        timing = by_slidax(PAIRS[name], PERIOD, STEPS, log_every=log_every).timing
        assert timing is not None
        again_s[name] = min(timing.compile_s, again_s.get(name, timing.compile_s))
        return time.perf_counter() - started - timing.compile_s

    again_s: dict[str, float] = {}
    compile_s = {name: by_slidax(PAIRS[name], PERIOD, STEPS).timing.compile_s for name in LAWS}
    contestants = {
        "OpenSMC": opensmc,
        "slidax, every sample logged": lambda name: slidax(name, 1),
        "slidax": lambda name: slidax(name, None),
    }
    times: dict[str, dict[str, list[float]]] = {law: {who: [] for who in contestants} for law in LAWS}
    for law in LAWS:
        for contestant in contestants.values():
            contestant(law)
    for _ in range(ROUNDS):
        for law in LAWS:
            for who, contestant in contestants.items():
                times[law][who].append(contestant(law) / STEPS * 1e9)
    return {
        "opensmc": version("opensmc"),
        "steps": STEPS,
        "ns_per_step": {
            law: {who: {"min": min(t), "median": statistics.median(t)} for who, t in of_law.items()}
            for law, of_law in times.items()
        },
        "compile_s": compile_s,
        "compile_again_s": again_s,
    }


if __name__ == "__main__":
    json.dump(measure(), sys.stdout)
