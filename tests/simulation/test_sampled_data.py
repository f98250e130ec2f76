"""The sampled-data law in the loop, with a sensor, an actuator and a recovery: in batches and under derivatives."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from slidax import scenarios
from slidax.core.types import State
from slidax.plant import Encoders, Lossy
from slidax.simulation import Plant, simulate, simulate_batch, value_and_gradient
from tests.enrolled import assert_same
from tests.paper_examples import MOTION_4_1

SCENARIO = scenarios.load("example-4.1-1khz")


HOW = {"period": 1e-3, "outside": "recover"}


def loop(law=SCENARIO.controller, shift=0.0, sensor=SCENARIO.plant.sensor):
    start = State(q=SCENARIO.state0.q + shift, dq=SCENARIO.state0.dq)
    plant = Plant(SCENARIO.plant.robot, SCENARIO.plant.disturbance, sensor, SCENARIO.plant.actuator)
    return plant, law, MOTION_4_1, start


def run(*law, t1=0.3, **changed):
    return simulate(*loop(*law, **changed), t1=t1, log_every=None, **HOW)


# XLA compiles a batch inside `jit`; `test_batches.py` does so with a simpler law.
@pytest.mark.parametrize("engine", ["native", pytest.param("xla", marks=pytest.mark.full)])
def test_a_batch_over_starts_and_seeds_equals_single_runs_also_outside_the_envelope(engine):
    shifts, seeds = jnp.array([[0.0, 0.0], [0.1, -0.2], [-0.9, 0.5], [0.0, 0.0]]), jnp.array([0, 0, 1, 2])

    def lossy(seed):
        return Lossy(Encoders(1e-6, 1e-6, 1e-4, seed), 0.1, seed=seed)

    def single(shift, seed):
        done = run(shift=shift, sensor=lossy(seed))
        return done.tally, done.excursion, done.state

    def batch():
        if engine == "xla":
            return jax.jit(jax.vmap(single))(shifts, seeds)
        done = simulate_batch(
            lambda x: loop(shift=x[0], sensor=lossy(x[1])), (shifts, seeds), t1=0.3, **HOW, engine="native"
        )
        return done.tally, done.excursion, done.state

    many = batch()
    for i, (shift, seed) in enumerate(zip(shifts, seeds, strict=True)):
        assert_same(jax.tree.map(lambda x, i=i: x[i], many), single(shift, seed), rtol=1e-7)
    assert np.array(many[0].violations > 0).tolist() == [False, False, True, False]
    assert np.array(many[1].first).tolist() == [-1, -1, 0, -1]
    # The first and the last run differ only in their seeds.
    assert many[0].torque_travel[0, 0] != many[0].torque_travel[3, 0]


def final_error(law):
    done = run(law, t1=0.1)
    return jnp.sum(jnp.abs(done.state.q - MOTION_4_1.position(jnp.asarray(0.1))))


@pytest.mark.full
def test_the_gradient_by_every_parameter_of_the_law_is_finite_and_mostly_nonzero():
    gradient = jax.jit(jax.grad(final_error))(SCENARIO.controller)
    leaves = [np.asarray(leaf) for leaf in jax.tree.leaves(gradient)]
    assert all(np.all(np.isfinite(leaf)) for leaf in leaves)
    assert sum(np.any(leaf != 0) for leaf in leaves) >= 15


GAINS = {
    "k2": lambda law: law.step.surface.k2,
    "gain": lambda law: law.step.reaching.gain,
    "b0": lambda law: law.step.bound.b0,
    "horizon": lambda law: law.horizon,
    "masses": lambda law: law.step.nominal.masses,
    "deadline": lambda law: law.step.transformation.performance.deadline,
}


def with_gains(x):
    law = eqx.tree_at(lambda law: [GAINS[name](law) for name in x], SCENARIO.controller, list(x.values()))
    return SCENARIO.plant, law, MOTION_4_1, SCENARIO.state0


# XLA differentiates the step of the law in `tests/laws/test_controllers.py`, too.
@pytest.mark.parametrize("engine", ["native", pytest.param("xla", marks=pytest.mark.full)])
def test_the_gradient_with_respect_to_a_gain_matches_finite_differences(engine):
    how = {"t1": 0.1, **HOW}
    goal = MOTION_4_1.position(jnp.asarray(0.1))

    def error(run):
        return jnp.sum(jnp.abs(run.state.q - goal))

    at = {name: where(SCENARIO.controller) for name, where in GAINS.items()}
    _, slopes = value_and_gradient(error, with_gains, at, engine=engine, **how)
    for name, value in at.items():
        shifted = {**at, name: value * (1.0 + 1e-5)}, {**at, name: value * (1.0 - 1e-5)}
        both = simulate_batch(with_gains, jax.tree.map(lambda *x: jnp.stack(x), *shifted), **how, engine="native")
        up, down = np.sum(np.abs(np.asarray(both.state.q) - np.asarray(goal)), axis=1)
        assert up != down
        slope = float(jnp.sum(slopes[name] * value)) * 1e-5
        assert slope == pytest.approx((up - down) / 2, rel=1e-4), name
