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


def test_a_batch_over_starts_and_seeds_is_the_single_runs_also_of_those_outside():
    shifts, seeds = jnp.array([[0.0, 0.0], [0.1, -0.2], [-0.9, 0.5], [0.0, 0.0]]), jnp.array([0, 0, 1, 2])

    def outcome(shift, seed):
        done = run(shift=shift, sensor=Lossy(Encoders(1e-6, 1e-6, 1e-4, seed), 0.1, seed=seed))
        return done.tally, done.excursion, done.state

    many = jax.jit(jax.vmap(outcome))(shifts, seeds)
    for i, (shift, seed) in enumerate(zip(shifts, seeds, strict=True)):
        assert_same(jax.tree.map(lambda x, i=i: x[i], many), outcome(shift, seed), rtol=1e-7)
    assert np.array(many[0].violations > 0).tolist() == [False, False, True, False]
    assert np.array(many[1].first).tolist() == [-1, -1, 0, -1]
    # The first and the last differ in nothing but their seeds.
    assert many[0].torque_travel[0, 0] != many[0].torque_travel[3, 0]


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

    @jax.jit
    @jax.vmap
    def value_and_slope(sign, way):
        shifted = jax.tree.map(lambda x, d: x + sign * d, law, way)
        return jax.jvp(final_error, (shifted,), (way,))

    # Every way from the law itself, from before it and from behind it, in one batch.
    signs = jnp.repeat(jnp.array([0.0, 1.0, -1.0]), len(ways))
    values, slopes = value_and_slope(signs, jax.tree.map(lambda x: jnp.concatenate([x, x, x]), directions))
    _, up, down = jnp.split(values, 3)
    assert np.all(up != down)
    for name, slope, difference in zip(GAINS, slopes[: len(ways)], (up - down) / 2, strict=True):
        assert float(slope) == pytest.approx(float(difference), rel=1e-4), name
