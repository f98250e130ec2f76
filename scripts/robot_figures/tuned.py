"""Rival laws with the best gains of a grid, found on the very run that they are shown on."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from slidax import metrics, scenarios, simulate_batch
from slidax.controllers import SampledData, sampled_data
from slidax.simulation import Run


@dataclass(frozen=True)
class Rival:
    """A law, and what of it is tried.

    - `scheme`: its name in a scenario file.
    - `title`: what it is called in a table.
    - `gains`: values by the names of the gains.
    - `chosen`: the leaves of the law that these are, in the same order.
    """

    scheme: str
    title: str
    gains: dict[str, list[float]]
    chosen: Callable[[Any], Any]


COMPUTED_TORQUE = Rival(
    "computed_torque",
    "computed torque + PD",
    {
        "kp": [50.0, 100.0, 200.0, 300.0, 400.0, 500.0, 600.0, 800.0, 1600.0, 3200.0],
        "kd": [10.0, 20.0, 40.0, 60.0, 80.0, 120.0, 160.0, 240.0, 320.0, 480.0, 640.0],
    },
    lambda law: (law.kp, law.kd),
)

SLOTINE_LI = Rival(
    "slotine_li",
    "Slotine-Li",
    {
        "rate": [10.0, 20.0, 40.0, 80.0],
        "damping": [2.5, 5.0, 10.0, 20.0, 40.0],
        "gain": [2.5, 5.0, 10.0, 20.0],
        "layer": [0.05, 0.1, 0.2, 0.5, 1.0],
    },
    lambda law: (law.surface.rate, law.damping, law.gain, law.layer),
)

SUPER_TWISTING = Rival(
    "super_twisting",
    "super-twisting",
    {
        "rate": [10.0, 20.0, 40.0, 80.0],
        "k1": [1.0, 3.0, 10.0, 20.0, 30.0],
        "k2": [1.0, 10.0, 100.0, 300.0, 1000.0],
    },
    lambda law: (law.surface.rate, law.k1, law.k2),
)


SEEN = 20
"""One in so many samples is looked at while gains are sought."""


def tuned(
    name: str, rival: Rival, changes: dict[str, Any], drawn: Run, *, sampled: bool
) -> tuple[Run, dict[str, float]]:
    """The best run of all gains that are tried, with every sample logged, and those gains.

    The best has the fewest samples outside the envelope that is drawn, and of those the least steady error.

    - `name`: of the scenario.
    - `rival`: the law.
    - `changes`: of the scenario, as in `scenarios.load`.
    - `drawn`: of the law that has the envelope, with every sample logged.
    - `sampled`: whether it has the scenario's estimator, prediction of the delay and limits, or is as in the textbook.
    """
    printed = scenarios.load(name, {"scheme.name": rival.scheme, **changes, "scheme.sampled_data": None})
    plain = {"scheme.name": rival.scheme, **changes, **({} if sampled else {"scheme.sampled_data": None})}
    scenario = scenarios.load(name, plain)
    grid = jnp.asarray(list(itertools.product(*rival.gains.values())))

    def define(gains: Any) -> Any:
        law = eqx.tree_at(rival.chosen, printed.controller, tuple(gains))
        like = scenario.controller
        if isinstance(like, SampledData):
            law = sampled_data(
                law,
                period=like.period,
                horizon=like.horizon,
                estimator=like.estimator,
                adaptation=like.adaptation,
                limits=like.limits,
                delay=like.delay,
                dead_time=like.dead_time,
            )
        return scenario.plant, law, scenario.trajectory, scenario.state0

    runs = simulate_batch(define, grid, t1=scenario.t1, stepping=scenario.stepping, log_every=SEEN)
    e = np.asarray(runs.log.e)
    lower, upper = (np.asarray(side)[::SEEN] for side in (drawn.log.envelope.lower, drawn.log.envelope.upper))
    counts = np.sum(np.any(~((lower < e) & (e < upper)), axis=2), axis=1)
    errors = np.max(np.asarray(runs.tally.steady_error), axis=1)
    ended = (np.asarray(runs.fault.kind) == 0) & np.isfinite(errors)
    order = np.lexsort((np.where(ended, errors, np.inf), np.where(ended, counts, np.inf)))
    best = dict(zip(rival.gains, np.asarray(grid[int(order[0])]).tolist(), strict=True))
    run = scenarios.load(name, {**plain, **{f"scheme.{gain}": value for gain, value in best.items()}}).simulate()
    assert metrics.steady_error(run) is not None
    return run, best
