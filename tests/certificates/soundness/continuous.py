"""`settling_time` and `ultimate_bound`: the printed law in continuous time on arms of constant inertia, in batches."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from slidax._types import State
from slidax.certificates.continuous import settling_time, ultimate_bound
from slidax.certificates.continuous.law import PrintedLaw
from slidax.controllers import cftsmppc
from slidax.performance import FixedTime
from slidax.reaching import UncertaintyBound
from slidax.scenarios import Scenario, load
from slidax.simulation import Plant, simulate_batch
from slidax.trajectories import Constant
from tests.certificates.loop.linear_arm import Changing, LinearArm

from .counted import Counted

PERIOD, END, EVERY = 1e-3, 4.0, 4
"""Of the integrator, of the runs [s], and of what is logged."""

TURNS = 40
"""How often what pushes turns within a run."""


def law_of(rng: np.random.Generator, joints: int, layered: bool) -> Any:
    """A random law with all hypotheses met: a constant inertia that it knows, and u beyond what pushes by k."""
    root = rng.normal(size=(joints, joints))
    inertia = np.eye(joints) * 10 ** rng.uniform(-0.5, 0.5)
    if rng.uniform() < 0.5:
        inertia = inertia + 0.1 * root @ root.T
    heaviest = float(np.linalg.eigvalsh(inertia)[-1])
    initial = rng.uniform(0.3, 1.5, joints)
    layer = float(10 ** rng.uniform(-2.0, -1.0)) if layered else 0.0
    return cftsmppc(
        LinearArm(inertia),
        performance=FixedTime(initial, initial * rng.uniform(0.02, 0.3, joints), rng.uniform(0.3, 1.5, joints), 2.01),
        overshoot=float(rng.uniform(0.1, 0.9)),
        bound=UncertaintyBound(1.0 / heaviest, 1.0 / heaviest, float(rng.uniform(0.5, 5.0)), 0.0, 0.0,
                               float(rng.uniform(1.0, 4.0))),
        gain=float(rng.uniform(0.1, 5.0)), exponent=float(rng.uniform(1.1, 1.8)), layer=layer,
        k1=float(rng.uniform(0.6, 2.0)), k2=float(rng.uniform(0.8, 2.5)), p=float(rng.uniform(0.3, 0.8)),
        q=float(rng.uniform(1.2, 1.8)), delta=float(rng.uniform(0.05, 0.3)),
    )  # fmt: skip


@lru_cache(maxsize=1)
def _base() -> Scenario:
    return load("example-4.1", {"simulation": {"mode": "continuous", "period": PERIOD, "t1": END}})


def scenario_of(law: Any, start: State, pushes: np.ndarray) -> Scenario:
    """The law on its own arm.

    - `law`: with its nominal arm.
    - `start`: at t = 0.
    - `pushes`: from outside, one after the other [k n], N m.
    """
    arm = Plant(law.nominal, Changing(pushes, END / len(pushes)))
    return _base().replace(plant=arm, controller=law, trajectory=Constant(np.zeros(law.joints)), state0=start, t1=END)


def starts_and_pushes(rng: np.random.Generator, law: Any, cases: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Errors over six decades, velocities and pushes as large as u allows for: steady ones, and ones that turn."""
    joints = law.joints
    initial = np.asarray(law.transformation.performance.initial)
    q = rng.choice([-1.0, 1.0], (cases, joints)) * initial * 10 ** rng.uniform(-6.0, -0.03, (cases, joints))
    dq = rng.uniform(-0.5, 0.5, (cases, joints)) * rng.choice([0.0, 1.0], (cases, 1))
    direction = rng.normal(size=(cases, TURNS, joints))
    steady = rng.uniform(size=cases) < 0.5
    direction[steady] = direction[steady][:, :1]
    size = float(law.bound.b0)
    return q, dq, size * direction / np.linalg.norm(direction, axis=2, keepdims=True)


def _runs(laws: list[Any], q: np.ndarray, dq: np.ndarray, pushes: np.ndarray) -> Any:
    """Each law with its own cases: arrays [laws cases ...]."""
    arrays, rest = eqx.partition(laws[0], eqx.is_array)
    stacked = [
        np.repeat(np.stack([np.asarray(leaf) for leaf in leaves]), q.shape[1], axis=0)
        for leaves in zip(*(_leaves(one) for one in laws), strict=True)
    ]
    flat = [one.reshape(-1, *one.shape[2:]) for one in (q, dq, pushes)]
    define = _Of(eqx.tree_at(_all, arrays, list(range(len(stacked))), is_leaf=lambda one: one is None), rest)
    return simulate_batch(
        define.parts, (stacked, *flat), t1=END, stepping=_base().stepping, log_every=EVERY, threads=1
    )


def _all(tree: Any) -> list[Any]:
    import jax

    return jax.tree.leaves(tree)


def _leaves(law: Any) -> list[Any]:
    return _all(eqx.filter(law, eqx.is_array))


class _Of:
    """From the arrays of a law, a start and pushes to a closed loop."""

    def __init__(self, numbered: Any, rest: Any) -> None:
        self.numbered, self.rest = numbered, rest

    def parts(self, given: Any) -> Any:
        import jax

        leaves, q, dq, pushes = given
        law = eqx.combine(jax.tree.map(lambda k: leaves[k], self.numbered), self.rest)
        plant = Plant(law.nominal, Changing(pushes, jnp.asarray(END / TURNS)))
        return plant, law, Constant(jnp.zeros(law.joints)), State(q=q, dq=dq)


def judged_settling(seed: int, laws: int, cases: int, joints: int, count: Counted) -> None:
    """Counts cases of random laws: when |ε1| <= δ for good, over the bound for the start.

    - `seed`: of all that is drawn.
    - `laws`, `cases`: how many, and of each.
    - `joints`: of the arms.
    - `count`: in which they are counted.
    """
    rng = np.random.default_rng([seed, joints, 0])
    made = [law_of(rng, joints, layered=False) for _ in range(laws)]
    drawn = [starts_and_pushes(rng, law, cases) for law in made]
    q, dq, pushes = (np.stack(each) for each in zip(*drawn, strict=True))
    run = _runs(made, q, dq, pushes)
    t = np.asarray(run.log.t)[0]
    e = np.asarray(run.log.e).reshape(laws, cases, -1, joints)
    for i, law in enumerate(made):
        shares = np.empty(cases)
        for k in range(cases):
            scenario = scenario_of(law, State(q=q[i, k], dq=dq[i, k]), pushes[i, k])
            verdict = settling_time(scenario)
            bound = np.asarray(verdict.bound["given_start"])
            assert verdict.holds, verdict.assumptions
            assert np.all(bound <= np.asarray(verdict.bound["supremum"]) * (1 + 1e-9))
            printed = PrintedLaw.of(scenario)
            sides = printed.places(np.stack([printed.powers.delta, -printed.powers.delta]))
            radius = printed.radius(t)
            outside = (e[i, k] > sides[0] * radius) | (e[i, k] < sides[1] * radius)
            seen = np.array([t[one].max() if one.any() else 0.0 for one in outside.T])
            shares[k] = np.max(seen / np.minimum(bound, END))
        count.kept(shares, joints, f"seed {seed}, law {i}, {joints} joints")


def judged_ultimate(seed: int, laws: int, cases: int, joints: int, count: Counted) -> None:
    """Counts cases of random laws with a layer: |e| in the last quarter over its bound.

    - `seed`, `laws`, `cases`, `joints`, `count`: as above.
    """
    rng = np.random.default_rng([seed, joints, 1])
    made = [law_of(rng, joints, layered=True) for _ in range(laws)]
    drawn = [starts_and_pushes(rng, law, cases) for law in made]
    q, dq, pushes = (np.stack(each) for each in zip(*drawn, strict=True))
    run = _runs(made, q, dq, pushes)
    late = np.asarray(run.log.t)[0] > 0.75 * END
    e = np.abs(np.asarray(run.log.e).reshape(laws, cases, -1, joints)[:, :, late]).max(axis=2)
    for i, law in enumerate(made):
        verdict = ultimate_bound(scenario_of(law, State(q=q[i, 0], dq=dq[i, 0]), pushes[i, 0]))
        if verdict.holds:
            count.kept(np.max(e[i] / np.asarray(verdict.bound["error"]), axis=1), joints, f"law {i}, {joints} joints")
