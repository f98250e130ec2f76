"""Every estimator is a pure function of arrays that identifies a constant disturbance and is always finite."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from slidax.core.types import State
from slidax.law import Estimate, FilteredDifference, Measured
from tests.enrolled import assert_finite, assert_float_leaves, assert_same, assert_same_form, every
from tests.law.followed import accelerated, followed, predicted, swinging
from tests.law.members import ESTIMATORS, ESTIMATORS_LIKE_OTHERS

PERIOD = jnp.asarray(1e-3)
PUSH = jnp.array([4.0, -0.5])
OF_POSITIONS = [case for case in ESTIMATORS if not case[0].startswith("measured")]
EVERY = every("estimator", ESTIMATORS, full=ESTIMATORS_LIKE_OTHERS)
WITHOUT_PUSH = [("measured_alone", Measured(0.0)), ("filtered_alone", FilteredDifference(200.0, 0.0))]


def arrays_of(q, dq):
    return State(q=jnp.asarray(q), dq=jnp.asarray(dq))


MEASURED = arrays_of([0.5, -0.3], [1.0, 2.0])
PRIOR = Estimate(state=arrays_of([0.49999, -0.3001], [1.01, 1.9]), disturbance=jnp.array([3.0, -1.0]))


FIRST = arrays_of([0.499, -0.302], [1.0, 2.0])


def uncompiled(estimator, measured=MEASURED, prior=PRIOR, elapsed=PERIOD, missed=False, first=FIRST):
    return estimator(measured, prior, elapsed, jnp.asarray(missed), estimator.init(first))


# One program serves all tests of a member.
compiled = eqx.filter_jit(uncompiled)


def answer(estimator, measured=MEASURED, prior=PRIOR, elapsed=PERIOD, missed=False, first=FIRST):
    return compiled(estimator, measured, prior, elapsed, jnp.asarray(missed), first)


@eqx.filter_jit
def driven(estimator, acceleration):
    """2000 estimates of a motion with a constant acceleration; one program serves all tests of a member."""
    return followed(estimator, accelerated(acceleration), 2000)


@EVERY
def test_compiled_and_eager_estimates_agree(estimator):
    with jax.disable_jit():
        eager = uncompiled(estimator)
    assert_same(answer(estimator), eager, rtol=1e-10)


@EVERY
def test_a_batch_over_parameters_equals_a_loop(estimator):
    acceleration, inputs = jnp.array([400.0, -500.0]), []
    for factor in (0.25, 0.5, 1.0):
        inputs += [jax.tree.map(lambda x, f=factor: x * f, estimator)]
    batch = eqx.filter_jit(jax.vmap(lambda estimator: followed(estimator, accelerated(acceleration), 20)))
    many = batch(jax.tree.map(lambda *parts: jnp.stack(parts), *inputs))
    alone = [jax.tree.map(lambda x: x[:20], driven(each, acceleration)) for each in inputs]
    looped = jax.tree.map(lambda *parts: jnp.stack(parts), *alone)
    assert_same(many, looped, rtol=1e-8)
    assert np.all(np.ptp(looped.disturbance, axis=0)[0] > 0)


@EVERY
def test_the_same_call_gives_bitwise_equal_estimates(estimator):
    assert_same(answer(estimator), answer(estimator))


@EVERY
def test_memory_keeps_its_tree_structure_shapes_and_types(estimator):
    memory, after = estimator.init(MEASURED), answer(estimator)[1]
    assert_same_form(after, memory)


@pytest.mark.parametrize("missed", [False, True])
@pytest.mark.parametrize("size", [0.0, 5e-324, 1e-160, 1e-3, 1e16, 1e150, 1e280])
@EVERY
def test_estimate_is_finite_for_any_measurement(estimator, size, missed):
    for signs in ([1.0, -1.0], [-1.0, 1.0]):
        far = size * jnp.asarray(signs)
        measured, none = State(q=far, dq=far), jnp.zeros(2)
        for prior in (
            PRIOR,
            Estimate(state=State(q=-far, dq=far), disturbance=-far),
            Estimate(state=State(q=none, dq=none), disturbance=none),
        ):
            assert_finite(answer(estimator, measured, prior, missed=missed))


@EVERY
def test_gradients_by_parameters_measurements_and_predictions_are_finite(estimator):
    @eqx.filter_jit
    @eqx.filter_grad
    def gradients(inputs):
        return sum(jnp.sum(leaf) for leaf in jax.tree.leaves(uncompiled(*inputs)))

    for residual in (0.0, 1e-12, 1.0):
        measured = State(q=PRIOR.state.q + residual, dq=PRIOR.state.dq)
        assert_finite(gradients((estimator, measured, PRIOR, PERIOD)))


@EVERY
def test_parameters_are_arrays_that_a_batch_can_vary(estimator):
    assert_float_leaves(estimator)


@every("estimator", ESTIMATORS + WITHOUT_PUSH, full=ESTIMATORS_LIKE_OTHERS)
def test_correct_prediction_is_kept(estimator):
    """A measurement that agrees with the prediction changes nothing."""
    last = Estimate(state=arrays_of([0.2, 0.1], [1.0, -2.0]), disturbance=jnp.array([3.0, -1.0]))
    prior = predicted(last, PERIOD)
    estimate, _ = answer(estimator, prior.state, prior, first=last.state)
    assert_same(estimate.state, prior.state, rtol=1e-13)
    np.testing.assert_allclose(estimate.disturbance, last.disturbance, rtol=1e-9)


@every("estimator", ESTIMATORS + WITHOUT_PUSH, full=ESTIMATORS_LIKE_OTHERS)
def test_a_constant_velocity_is_followed_without_error(estimator):
    estimate = jax.tree.map(lambda x: x[:200], driven(estimator, jnp.zeros(2)))
    times = np.arange(1, 201)[:, None] * 1e-3
    np.testing.assert_allclose(estimate.state.q, times * [1.0, -2.0], atol=1e-13)
    np.testing.assert_allclose(estimate.state.dq, np.tile([1.0, -2.0], (200, 1)), atol=1e-11)
    np.testing.assert_allclose(estimate.disturbance, 0.0, atol=1e-8)


@EVERY
def test_estimates_become_exact_under_a_constant_disturbance(estimator):
    estimate = driven(estimator, PUSH)
    np.testing.assert_allclose(estimate.disturbance[-1], PUSH, atol=1e-6)
    np.testing.assert_allclose(estimate.state.dq[-1], [9.0, -3.0], atol=1e-8)
    np.testing.assert_allclose(estimate.state.q[-1], [10.0, -5.0], atol=1e-10)


@EVERY
def test_estimate_of_a_constant_disturbance_overshoots_by_less_than_half(estimator):
    estimate = np.asarray(driven(estimator, PUSH).disturbance) / np.asarray(PUSH)
    assert np.all(estimate > -0.01) and np.all(estimate < 1.5)


@eqx.filter_jit
def swung(estimator):
    return followed(estimator, swinging, 8000)


@EVERY
def test_a_slowly_changing_disturbance_is_tracked(estimator):
    estimate = swung(estimator)
    times = jnp.asarray(np.arange(1, 8001) * 1e-3)
    right = jax.vmap(swinging)(times)
    np.testing.assert_allclose(estimate.disturbance[3000:], -right.q[3000:], atol=0.1)
    np.testing.assert_allclose(estimate.state.dq[3000:], right.dq[3000:], atol=2e-3)
    np.testing.assert_allclose(estimate.state.q[3000:], right.q[3000:], atol=2e-5)


@every("estimator", WITHOUT_PUSH)
def test_a_gain_of_zero_keeps_the_disturbance_estimate(estimator):
    estimate = followed(estimator, accelerated(PUSH), 100, disturbance=0.25)
    np.testing.assert_array_equal(estimate.disturbance, 0.25)


@EVERY
def test_a_long_gap_keeps_the_disturbance_and_takes_the_measured_position(estimator):
    estimate, _ = answer(estimator, elapsed=jnp.asarray(1.0), missed=True)
    np.testing.assert_array_equal(estimate.disturbance, PRIOR.disturbance)
    np.testing.assert_allclose(estimate.state.q, MEASURED.q, rtol=1e-6)


@EVERY
def test_velocity_estimate_after_a_gap_is_closer_than_the_prediction(estimator):
    true = accelerated(PUSH)
    for elapsed in (jnp.asarray(0.002), jnp.asarray(0.02), jnp.asarray(0.5)):
        last = Estimate(state=true(jnp.asarray(0.5)), disturbance=jnp.zeros(2))
        measured, prior = true(0.5 + elapsed), predicted(last, elapsed)
        estimate, _ = answer(estimator, measured, prior, elapsed, missed=True, first=last.state)
        before = np.abs(prior.state.dq - measured.dq)
        assert np.all(np.abs(estimate.state.dq - measured.dq) < before)


@EVERY
def test_each_joint_is_estimated_independently(estimator):
    other = arrays_of([MEASURED.q[0], 7.0], [MEASURED.dq[0], -7.0])
    for a, b in zip(jax.tree.leaves(answer(estimator)), jax.tree.leaves(answer(estimator, other)), strict=True):
        assert a[0] == b[0]


@every("estimator", OF_POSITIONS, full=ESTIMATORS_LIKE_OTHERS)
def test_position_estimators_ignore_measured_velocities(estimator):
    other = arrays_of(MEASURED.q, [50.0, -50.0])
    assert_same(answer(estimator, other), answer(estimator))
