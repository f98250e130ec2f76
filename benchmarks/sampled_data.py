"""The sampled-data law and the printed one: nanoseconds per closed-loop step, and of the law alone, in turns.

Run as a program of its own, `python -m benchmarks.sampled_data`, so that it can be bound to one core from the start.
"""

from __future__ import annotations

import json
import os
import statistics
import sys
import time
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

    from benchmarks import machine

    jax.config.update("jax_enable_x64", True)
    machine.well_made_from_the_start()
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


def _alone(law: Any, plant: Any, motion: Any, start: Any) -> Callable[[], float]:
    """The law over states that a run of it went through: what a controller costs that has a real arm for a plant."""
    import equinox as eqx
    import jax
    import jax.numpy as jnp
    from jax.flatten_util import ravel_pytree

    from slidax import simulate
    from slidax.core import barrier, semi_implicit_euler

    options: dict[str, Any] = {"period": PERIOD, "integrator": semi_implicit_euler, "log_every": 1}
    log = simulate(plant, law, motion, start, t1=STEPS * PERIOD, **options).log
    states, now = jax.tree.map(jnp.asarray, (log.state, log.reference))
    following = jax.tree.map(lambda x: jnp.roll(x, -1, axis=0), now)
    arrays, rest = eqx.partition(law, eqx.is_inexact_array)
    packed, unpack = ravel_pytree(arrays)

    @jax.jit
    def run(packed: Any, rows: Any) -> Any:
        def step(carry: Any, row: Any) -> Any:
            memory, k, total = carry
            state, reference, ahead = row
            same = eqx.combine(unpack(barrier(packed)), rest)
            command = same(k.astype(float) * PERIOD, state, reference, ahead, memory)
            return (command.memory, k + 1, total + command.tau), None

        first, reference = jax.tree.map(lambda x: x[0], (states, now))
        memory = law.init(jnp.zeros(()), first, reference)
        carry = (memory, jnp.zeros((), int), jnp.zeros(law.joints))
        return jax.lax.scan(step, carry, rows)[0][2]

    def timed() -> float:
        began = time.perf_counter()
        jax.block_until_ready(run(packed, (states, now, following)))
        return (time.perf_counter() - began) / STEPS * 1e9

    return timed


def _arms() -> dict[str, dict[str, Callable[[], float]]]:
    from benchmarks.chain import Chain
    from slidax import scenarios
    from slidax.core.types import State
    from slidax.law import FixedTime, UncertaintyBound, cftsmppc
    from slidax.motions import Sinusoid
    from slidax.plant import Constant
    from slidax.simulation import Plant

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

    from slidax.law import Recovery, sampled_data
    from slidax.plant import TorqueLimits

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
    whole = {name: _contestant(plant, law, motion, start) for name, law in laws.items()}
    alone = {f"{name}, law alone": _alone(law, plant, motion, start) for name, law in list(laws.items())[:3]}
    return whole | alone


def _contestant(plant: Any, law: Any, motion: Any, start: Any) -> Callable[[], float]:
    from slidax import simulate
    from slidax.core import semi_implicit_euler

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
