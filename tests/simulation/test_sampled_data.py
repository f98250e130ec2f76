"""The sampled-data law in the loop, with a sensor, an actuator and a recovery: in batches and under derivatives."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from slidax import scenarios
from slidax._types import State
from slidax.sensors import Encoders, Lossy
from slidax.simulation import Plant, simulate
from tests.paper import MOTION_4_1

SCENARIO = scenarios.load("example-4.1-1khz")


def run(law=SCENARIO.controller, shift=0.0, sensor=SCENARIO.plant.sensor, t1=0.3, **extra):
    start = State(q=SCENARIO.state0.q + shift, dq=SCENARIO.state0.dq)
    plant = Plant(SCENARIO.plant.robot, SCENARIO.plant.disturbance, sensor, SCENARIO.plant.actuator)
    extra = {"period": 1e-3, "log_every": None, "outside": "recover"} | extra
    return simulate(plant, law, MOTION_4_1, start, t1=t1, **extra)


def assert_same(a, b, rtol):
    for x, y in zip(jax.tree.leaves(a), jax.tree.leaves(b), strict=True):
        np.testing.assert_allclose(x, y, rtol=rtol, atol=rtol)


def test_a_batch_over_starts_is_the_single_runs_also_of_those_outside():
    shifts = jnp.array([[0.0, 0.0], [0.1, -0.2], [-0.9, 0.5]])

    def outcome(shift):
        done = run(shift=shift)
        return done.tally, done.excursion, done.state

    many = jax.jit(jax.vmap(outcome))(shifts)
    for i, shift in enumerate(shifts):
        assert_same(jax.tree.map(lambda x, i=i: x[i], many), outcome(shift), rtol=1e-7)
    assert np.array(many[0].violations > 0).tolist() == [False, False, True]
    assert np.array(many[1].first).tolist() == [-1, -1, 0]


def test_a_batch_over_seeds_is_the_single_runs():
    def tally(seed):
        return run(sensor=Lossy(Encoders(1e-6, 1e-6, 1e-4, seed), 0.1, seed=seed), t1=0.1).tally

    many = jax.jit(jax.vmap(tally))(jnp.arange(3))
    for i in range(3):
        assert_same(jax.tree.map(lambda x, i=i: x[i], many), tally(i), rtol=1e-7)
    assert len(np.unique(many.torque_travel[:, 0])) == 3


def final_error(law):
    done = run(law, t1=0.1)
    return jnp.sum(jnp.abs(done.state.q - MOTION_4_1.position(jnp.asarray(0.1))))


@pytest.mark.full
def test_the_gradient_by_every_number_of_the_law_is_finite_and_most_of_them_count():
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


def test_the_gradient_by_a_gain_is_that_of_differences():
    law = SCENARIO.controller
    none = jax.tree.map(jnp.zeros_like, law)
    ways = [eqx.tree_at(where, none, 1e-5 * where(law)) for where in GAINS.values()]
    directions = jax.tree.map(lambda *parts: jnp.stack(parts), *ways)

    def shifted(way, sign):
        return final_error(jax.tree.map(lambda x, d: x + sign * d, law, way))

    slopes = jax.jit(jax.vmap(lambda way: jax.jvp(final_error, (law,), (way,))[1]))(directions)
    up, down = jax.jit(jax.vmap(jax.vmap(shifted, (0, None)), (None, 0)))(directions, jnp.array([1.0, -1.0]))
    assert np.all(up != down)
    for name, slope, difference in zip(GAINS, slopes, (up - down) / 2, strict=True):
        assert float(slope) == pytest.approx(float(difference), rel=1e-4), name
