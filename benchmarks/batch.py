"""Many closed loops at once: `vmap` over a gain. Run as `python -m benchmarks.batch`."""

from __future__ import annotations

import json
import sys
import time
from typing import Any

RUNS = 1024
STEPS = 2_000


def measure() -> dict[str, Any]:
    """Closed-loop steps per second of a batch of Example 4.1, held, on all cores that XLA takes."""
    import jax

    jax.config.update("jax_enable_x64", True)
    import equinox as eqx
    import jax.numpy as jnp

    from slidax import scenarios, simulate
    from slidax.numerics import semi_implicit_euler

    scenario = scenarios.load("example-4.1")

    @eqx.filter_jit
    @eqx.filter_vmap
    def steady_error(k1: Any) -> Any:
        controller = eqx.tree_at(lambda c: c.surface.k1, scenario.controller, k1)
        run = simulate(
            scenario.plant,
            controller,
            scenario.trajectory,
            scenario.state0,
            t1=STEPS * scenario.period,
            period=scenario.period,
            integrator=semi_implicit_euler,
            log_every=None,
        )
        return run.tally.steady_error

    gains = jnp.linspace(0.1, 0.4, RUNS)
    started = time.perf_counter()
    steady_error(gains).block_until_ready()
    compile_s = time.perf_counter() - started
    times = []
    for _ in range(5):
        started = time.perf_counter()
        steady_error(gains).block_until_ready()
        times.append(time.perf_counter() - started)
    return {"runs": RUNS, "steps": STEPS, "steps_per_s": RUNS * STEPS / min(times), "first_call_s": compile_s}


if __name__ == "__main__":
    json.dump(measure(), sys.stdout)
