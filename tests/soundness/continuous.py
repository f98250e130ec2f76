"""`settling_time` and `ultimate_bound`: the printed law in continuous time on arms of constant inertia, in batches."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import jax.numpy as jnp
import numpy as np

from slidax.certify.printed import settling_time, ultimate_bound
from slidax.certify.printed.printed_law import PrintedLaw
from slidax.core.types import State
from slidax.law import FixedTime, UncertaintyBound, cftsmppc
from slidax.motions import ConstantPosture
from slidax.scenarios import Scenario, load
from slidax.simulation import Plant

from .batches import simulated
from .counted import Counted
from .linear_arm import Changing, LinearArm

PERIOD, END, EVERY = 1e-3, 4.0, 4
"""Integrator period and duration of the runs, s, and log interval."""

FINER = 10
"""Refinement of a run that exceeds a bound: bounds of continuous time ignore the integrator's error."""

TURNS = 40
"""Changes of the disturbance within a run."""


def law_of(rng: np.random.Generator, joints: int, layered: bool) -> Any:
    """A random law that meets all assumptions: a constant, known inertia, and u above the disturbance by k."""
    root = rng.normal(size=(joints, joints))
    inertia = np.eye(joints) * 10 ** rng.uniform(-1.0, 0.2)
    if rng.uniform() < 0.5:
        inertia = inertia + 0.05 * root @ root.T
    heaviest = float(np.linalg.eigvalsh(inertia)[-1])
    initial = rng.uniform(0.3, 1.5, joints)
    layer = float(10 ** rng.uniform(-2.0, -1.0)) if layered else 0.0
    return cftsmppc(
        LinearArm(inertia),
        performance=FixedTime(initial, initial * rng.uniform(0.02, 0.3, joints), rng.uniform(0.3, 1.5, joints), 2.01),
        overshoot=float(rng.uniform(0.1, 0.9)),
        bound=UncertaintyBound(1.0 / heaviest, 1.0 / heaviest, float(rng.uniform(0.5, 5.0)), 0.0, 0.0,
                               float(rng.uniform(2.0, 8.0))),
        gain=float(rng.uniform(0.1, 5.0)), exponent=float(rng.uniform(1.1, 1.8)), layer=layer,
        k1=float(rng.uniform(0.6, 2.0)), k2=float(rng.uniform(0.8, 2.5)), p=float(rng.uniform(0.3, 0.8)),
        q=float(rng.uniform(1.2, 1.8)), delta=float(rng.uniform(0.05, 0.3)),
    )  # fmt: skip


@lru_cache(maxsize=2)
def _base(finer: int = 1) -> Scenario:
    return load("example-4.1", {"simulation": {"mode": "continuous", "period": PERIOD / finer, "t1": END}})


def _parts(law: Any) -> dict[str, Any]:
    still = np.zeros(law.joints)
    arm = Plant(law.nominal, Changing(still[None], END))
    return {
        "plant": arm,
        "controller": law,
        "trajectory": ConstantPosture(still),
        "state0": State(q=still, dq=still),
        "t1": END,
    }


def scenario_of(law: Any, start: State, pushes: np.ndarray) -> Scenario:
    """The law on its own arm."""
    arm = Plant(law.nominal, Changing(pushes, END / len(pushes)))
    return _base().replace(**{**_parts(law), "plant": arm, "state0": start})


def starts_and_pushes(rng: np.random.Generator, law: Any, cases: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Errors over six decades, velocities, and disturbances as large as u allows: constant ones, and changing ones."""
    joints = law.joints
    initial = np.asarray(law.transformation.performance.initial)
    q = rng.choice([-1.0, 1.0], (cases, joints)) * initial * 10 ** rng.uniform(-6.0, -0.03, (cases, joints))
    dq = rng.uniform(-0.5, 0.5, (cases, joints)) * rng.choice([0.0, 1.0], (cases, 1))
    direction = rng.normal(size=(cases, TURNS, joints))
    steady = rng.uniform(size=cases) < 0.5
    direction[steady] = direction[steady][:, :1]
    size = float(law.bound.b0)
    return q, dq, size * direction / np.linalg.norm(direction, axis=2, keepdims=True)


@dataclass(frozen=True)
class Runs:
    """All cases of one law.

    - `t`: [K], s.
    - `e`, `s`: errors and sliding variables [cases K n]; not finite after a failure.
    """

    t: np.ndarray
    e: np.ndarray
    s: np.ndarray


def _runs(laws: list[Any], q: np.ndarray, dq: np.ndarray, pushes: np.ndarray, finer: int = 1) -> list[Runs]:
    """Run each law with its own cases: arrays [laws cases ...]."""

    def parts(law: Any, values: Any) -> Any:
        start, speed, torques = values
        plant = Plant(law.nominal, Changing(torques, jnp.asarray(END / TURNS)))
        return plant, law, ConstantPosture(jnp.zeros(law.joints)), State(q=start, dq=speed)

    run = simulated(laws, (q, dq, pushes), parts, t1=END, stepping=_base(finer).stepping, log_every=EVERY * finer)
    t = np.asarray(run.log.t)[0]
    e = np.asarray(run.log.e).reshape(*q.shape[:2], len(t), -1)
    s = np.asarray(run.log.signals["s"]).reshape(e.shape)
    return [Runs(t, *item) for item in zip(e, s, strict=True)]


def _judged(
    laws: list[Any],
    drawn: tuple[np.ndarray, np.ndarray, np.ndarray],
    shares: Callable[[int, Runs], np.ndarray],
    count: Counted,
) -> None:
    """Count each case by its share of the bound; laws that exceed it are run again with a finer integrator."""
    for i, run in enumerate(_runs(laws, *drawn)):
        each = shares(i, run)
        if not np.all(each <= 1.0):
            (run,) = _runs(laws[i : i + 1], *(item[i : i + 1] for item in drawn), finer=FINER)
            each = shares(i, run)
            count.again += 1
        count.kept(each, laws[i].joints, f"law {i}, {laws[i].joints} joints")


def judged_settling(seed: int, laws: int, cases: int, joints: int, count: Counted, each: int = 4) -> None:
    """Count cases of random laws: the time of final entry into |ε1| <= δ, over the bound for this or any start."""
    rng = np.random.default_rng([seed, joints, 0])
    random_laws = [law_of(rng, joints, layered=False) for _ in range(laws)]
    drawn = [starts_and_pushes(rng, law, cases) for law in random_laws]
    q, dq, pushes = (np.stack(item) for item in zip(*drawn, strict=True))

    def shares(i: int, run: Runs) -> np.ndarray:
        law = random_laws[i]
        scenarios = [scenario_of(law, State(q=q[i, k], dq=dq[i, k]), pushes[i, k]) for k in range(min(each, cases))]
        verdicts = [settling_time(item) for item in scenarios]
        assert all(item.holds for item in verdicts), verdicts[0].assumptions
        supremum = np.asarray(verdicts[0].bound["supremum"])
        bounds = np.stack([*(np.asarray(item.bound["given_start"]) for item in verdicts), *[supremum] * (cases - each)])
        assert np.all(bounds <= supremum * (1 + 1e-9))
        assert np.all(supremum <= np.asarray(verdicts[0].bound["printed"]) * (1 + 1e-9))
        printed = PrintedLaw.of(scenarios[0])
        sides = printed.psi(np.stack([printed.powers.delta, -printed.powers.delta]))
        radius = printed.radius(run.t)
        # A run that broke off is at no time inside.
        outside = ~((run.e <= sides[0] * radius) & (run.e >= sides[1] * radius))
        last = len(run.t) - 1 - np.argmax(outside[:, ::-1], axis=1)
        times = np.where(outside.any(axis=1), run.t[last], 0.0)
        return (times / bounds)[bounds < END]

    _judged(random_laws, (q, dq, pushes), shares, count)


def judged_ultimate(seed: int, laws: int, cases: int, joints: int, count: Counted) -> None:
    """Count cases of random laws with a layer: |e| over its bound, once s and e are as small as the bound assumes."""
    rng = np.random.default_rng([seed, joints, 1])
    random_laws = [law_of(rng, joints, layered=True) for _ in range(laws)]
    drawn = [starts_and_pushes(rng, law, cases) for law in random_laws]
    q, dq, pushes = (np.stack(item) for item in zip(*drawn, strict=True))

    def shares(i: int, run: Runs) -> np.ndarray:
        law = random_laws[i]
        verdict = ultimate_bound(scenario_of(law, State(q=q[i, 0], dq=dq[i, 0]), pushes[i, 0]))
        if not verdict.holds:
            return np.zeros(0)
        values = np.linalg.eigvalsh(np.asarray(law.nominal.inertia))
        small = float(verdict.bound["sliding_variable"]) / np.sqrt(values[-1] / values[0])
        radius = PrintedLaw.of(_base().replace(**_parts(law))).radius(run.t)
        share = np.max(np.abs(run.e) / (np.asarray(verdict.bound["error"]) * radius / radius[-1]), axis=2)
        near = (np.linalg.norm(run.s, axis=2) <= small) & (share <= 1.0)
        kept = np.max(np.where(np.maximum.accumulate(near, axis=1), share, 0.0), axis=1)
        # A run that broke off is beyond any bound.
        kept = np.where(np.isfinite(run.e).all(axis=(1, 2)), kept, np.inf)
        return kept[near.any(axis=1) | np.isinf(kept)]

    _judged(random_laws, (q, dq, pushes), shares, count)
