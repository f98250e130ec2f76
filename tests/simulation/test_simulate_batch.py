"""Many runs at once are the single runs, whoever runs them and on however many threads."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from slidax.core.errors import DefinitionError
from slidax.core.types import State
from slidax.motions import ConstantPosture
from slidax.plant import DifferencedEncoders
from slidax.simulation import Plant, simulate, simulate_batch
from tests.paper_examples import DISTURBANCE_4_1, MOTION_4_1, START_4_1, TWO_LINK, law_4_1, plant_4_1
from tests.simulation.simple import SMOOTH_PLANT, SPRING, BoundedLaw, Spring

HOW = {"t1": 0.4, "period": 1e-3}
SHIFTS = jnp.linspace(-0.02, 0.02, 11)


def shifted(given):
    k2, shift = given
    law = eqx.tree_at(lambda c: c.surface.k2, law_4_1(), k2)
    return plant_4_1(), law, MOTION_4_1, State(q=START_4_1.q + shift, dq=START_4_1.dq)


VARIED = (jnp.linspace(0.4, 0.8, 11), SHIFTS)


def test_a_run_of_a_native_batch_has_the_very_bits_of_the_single_run():
    many = simulate_batch(shifted, VARIED, **HOW, log_every=50, engine="native")
    for i in (0, 5, 10):
        one = simulate(*shifted((VARIED[0][i], VARIED[1][i])), **HOW, log_every=50, engine="native")
        for a, b in zip(jax.tree.leaves((many.tally, many.log)), jax.tree.leaves((one.tally, one.log)), strict=True):
            np.testing.assert_array_equal(np.asarray(a)[i], b)


@pytest.mark.full
def test_both_engines_give_the_same_batch():
    native, xla = (simulate_batch(shifted, VARIED, **HOW, log_every=20, engine=engine) for engine in ("native", "xla"))
    assert jax.tree.structure(native) == jax.tree.structure(xla)
    for ours, theirs in zip(jax.tree.leaves(native), jax.tree.leaves(xla), strict=True):
        assert (ours.shape, ours.dtype) == (theirs.shape, theirs.dtype)
        np.testing.assert_allclose(ours, theirs, rtol=1e-8, atol=1e-9)


def test_the_number_of_threads_changes_no_bit():
    once, twice = (simulate_batch(shifted, VARIED, **HOW, engine="native", threads=threads) for threads in (1, 2))
    for a, b in zip(jax.tree.leaves(once), jax.tree.leaves(twice), strict=True):
        np.testing.assert_array_equal(a, b)


@pytest.mark.parametrize("engine", ["native", "xla"])
def test_a_batch_tells_which_runs_went_wrong_where_and_when(engine):
    def bounded(radius):
        law = BoundedLaw(Spring(jnp.zeros(2), jnp.zeros(2)), radius)
        start = State(q=jnp.array([np.pi / 2, 0.0]), dq=jnp.array([1.0, 0.0]))
        return SMOOTH_PLANT, law, ConstantPosture([np.pi / 2, 0.0]), start

    done = simulate_batch(bounded, jnp.array([0.095, 10.0, 0.135]), t1=0.4, period=0.04, log_every=1, engine=engine)
    assert done.fault.kind.tolist() == [1, 0, 1]
    np.testing.assert_allclose(done.fault.t[::2], [0.12, 0.16], atol=1e-12)
    assert np.sum(done.log.valid, axis=1).tolist() == [3, 11, 4]
    assert done.tally.violations.tolist() == [1, 0, 1]


def test_each_run_has_its_own_random_numbers():
    def noisy(seed):
        sensor = DifferencedEncoders(resolution=1e-5, position_noise=1e-5, seed=seed)
        return Plant(TWO_LINK, DISTURBANCE_4_1, sensor), SPRING, MOTION_4_1, START_4_1

    seeds = jnp.array([0, 7, 7])
    native, xla = (simulate_batch(noisy, seeds, t1=0.1, period=1e-3, engine=engine) for engine in ("native", "xla"))
    np.testing.assert_allclose(native.tally.torque_travel, xla.tally.torque_travel, rtol=1e-6)
    assert np.all(native.tally.torque_travel[0] != native.tally.torque_travel[1])
    np.testing.assert_array_equal(native.tally.torque_travel[1], native.tally.torque_travel[2])


@pytest.mark.full
def test_a_batch_inside_jit_goes_by_xla():
    def error(gain):
        return simulate_batch(shifted, (gain, jnp.zeros(2)), t1=0.05, period=1e-3).tally.steady_error

    inside = jax.jit(error)(jnp.array([0.5, 0.6]))
    np.testing.assert_allclose(inside, error(jnp.array([0.5, 0.6])), rtol=1e-9)


@pytest.mark.parametrize("varied", [(), jnp.zeros(()), (jnp.zeros(3), jnp.zeros(2)), jnp.zeros((0, 2))])
def test_arrays_without_one_first_axis_are_refused(varied):
    with pytest.raises(DefinitionError, match="first axis"):
        simulate_batch(shifted, varied, **HOW)


def test_parts_that_do_not_fit_are_refused():
    with pytest.raises(DefinitionError, match="the trajectory gives"):
        simulate_batch(
            lambda x: (SMOOTH_PLANT, SPRING, ConstantPosture([0.0]), START_4_1), jnp.zeros(2), t1=0.1, period=0.01
        )
