"""Every sensor is a pure function of arrays, random only by its seed, and always finite."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from slidax.core.types import State
from tests.enrolled import assert_finite, assert_same, assert_same_form, every, stacked
from tests.plant.sensors.members import LIKE_OTHERS, SENSORS
from tests.plant.sensors.sampled import moving, sampled

PERIOD = jnp.asarray(1e-2)
RANDOM = ("noisy", "unevenly", "by_chance", "all_at_once")
SHIFTS = jnp.array([0.0, 0.3, 2.0])
BY_CHANCE = [case for case in SENSORS if case[0].endswith(RANDOM)]
EVERY = every("sensor", SENSORS, full=LIKE_OTHERS)


def of_a_motion(sensor, shift):
    """Measurements of the motion `moving`, `shift` seconds later."""
    return sampled(sensor, lambda t: moving(t + shift), samples=40)


measured = eqx.filter_jit(of_a_motion)
measured_of_many = eqx.filter_jit(jax.vmap(of_a_motion))


@eqx.filter_jit
def measured_of_jumps(sensor, size):
    signs = jnp.array([1.0, -1.0])

    def jumping(t):
        side = jnp.where(jnp.sin(500.0 * t) >= 0, 1.0, -1.0)
        return State(q=size * side * signs, dq=-size * side * signs)

    return sampled(sensor, jumping, samples=20, period=1e-3)


@eqx.filter_jit
@eqx.filter_grad
def slopes(inputs):
    sensor, scale = inputs
    measurement = sampled(sensor, lambda t: jax.tree.map(lambda x: scale * x, moving(t))).state
    return jnp.sum(measurement.q) + jnp.sum(measurement.dq)


def one_by_one(sensor, samples):
    memory, measurements = sensor.init(moving(jnp.zeros(()))), []
    for k in range(samples):
        state = moving(jnp.asarray(k * 1e-2))
        measurement, memory = sensor(jnp.asarray(k), state, PERIOD, memory)
        measurements.append(measurement)
    return stacked(measurements)


@EVERY
def test_compiled_and_eager_measurements_agree(sensor):
    """Over enough samples for all delays to act and for the planned losses to occur."""
    first = jax.tree.map(lambda x: x[:8], measured(sensor, SHIFTS[0]))
    assert_same(first, one_by_one(sensor, 8), rtol=1e-11)


@EVERY
def test_a_batch_over_motions_equals_a_loop_over_motions(sensor):
    many = measured_of_many(stacked([sensor] * 3), SHIFTS)
    assert_same(many, stacked([measured(sensor, shift) for shift in SHIFTS]), rtol=1e-11)


@every("sensor", BY_CHANCE, full=(*LIKE_OTHERS, "all_at_once"))
def test_a_batch_over_seeds_equals_a_loop_and_each_seed_gives_other_noise(sensor):
    sensors = [eqx.tree_at(lambda sensor: sensor.seed, sensor, jnp.asarray(seed)) for seed in range(3)]
    looped = stacked([measured(sensor, SHIFTS[0]) for sensor in sensors])
    assert_same(measured_of_many(stacked(sensors), jnp.zeros(3)), looped, rtol=1e-11)
    for a, b in ((0, 1), (1, 2), (0, 2)):
        assert np.any(looped.state.q[a] != looped.state.q[b])


@EVERY
def test_the_same_call_gives_bitwise_equal_measurements(sensor):
    assert_same(measured(sensor, SHIFTS[0]), measured(sensor, SHIFTS[0]))


@EVERY
def test_the_first_sample_arrives_and_is_near_the_truth(sensor):
    first = jax.tree.map(lambda x: x[0], measured(sensor, SHIFTS[0]))
    assert bool(first.fresh)
    # At most 2.5 periods late at 3 rad/s, and rounded.
    np.testing.assert_allclose(first.state.q, moving(jnp.zeros(())).q, atol=0.08)
    np.testing.assert_allclose(first.state.dq, moving(jnp.zeros(())).dq, atol=0.02)


@EVERY
def test_memory_keeps_its_tree_structure_shapes_and_types(sensor):
    memory = sensor.init(moving(jnp.zeros(())))
    after = sensor(jnp.asarray(0), moving(jnp.zeros(())), PERIOD, memory)[1]
    assert_same_form(after, memory)


@pytest.mark.parametrize("size", [0.0, 5e-324, 1e-160, 1e16, 1e150, 1e280])
@EVERY
def test_measurement_is_finite_for_any_state(sensor, size):
    assert_finite(measured_of_jumps(sensor, jnp.asarray(size)))


@EVERY
def test_gradients_by_parameters_and_states_are_finite(sensor):
    assert_finite(slopes((sensor, jnp.ones(()))))


@EVERY
def test_parameters_are_arrays_that_a_batch_can_vary(sensor):
    assert all(isinstance(leaf, jax.Array) for leaf in jax.tree.leaves(sensor))


@EVERY
def test_a_single_compilation_serves_all_samples_and_seeds(sensor):
    traces = []

    @eqx.filter_jit
    def call(sensor, k, state, memory):
        traces.append(None)
        return sensor(k, state, PERIOD, memory)

    state = moving(jnp.zeros(()))
    for k in range(4):
        factor = jax.tree.map(lambda x, k=k: x + jnp.asarray(k, x.dtype), sensor)
        call(factor, jnp.asarray(k), state, sensor.init(state))
    assert len(traces) == 1
