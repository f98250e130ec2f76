"""Every transformation maps its envelope onto the real line, and returns the rate of the mapped error."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from slidax.law import Unconstrained
from tests.enrolled import assert_finite, every
from tests.law.members import TRANSFORMATIONS, TRANSFORMATIONS_LIKE_OTHERS

ENVELOPED = [(name, member) for name, member in TRANSFORMATIONS if not isinstance(member, Unconstrained)]
EVERY = every("transformation", TRANSFORMATIONS, full=TRANSFORMATIONS_LIKE_OTHERS)
STARTS = [jnp.array([0.3, 0.2]), jnp.array([-0.3, 0.2]), jnp.array([-0.3, -0.2]), jnp.zeros(2)]


def motion(t):
    """A motion of the error inside every member's envelope, at any t in [0, 1]."""
    return 0.02 * jnp.array([1.0, 0.5]) * jnp.sin(jnp.array([3.0, 2.0]) * t + jnp.array([0.3, -0.4]))


def along(transformation, memory, t):
    e, de = jax.jvp(motion, (t,), (jnp.ones_like(t),))
    return transformation(t, e, de, memory)


@eqx.filter_jit
def errors_and_rate(transformation, memory, t):
    """The first error with its derivative, and the second error."""
    first = jax.jvp(lambda t: along(transformation, memory, t).eps1, (t,), (jnp.ones_like(t),))
    return first, along(transformation, memory, t).eps2


@EVERY
@pytest.mark.parametrize("start", STARTS)
def test_the_second_transformed_error_is_the_time_derivative_of_the_first(transformation, start):
    memory, h = transformation.init(jnp.asarray(0.0), start), 1e-6
    for t in (0.0, 0.4, 0.9):
        (_, true_rate), rate = errors_and_rate(transformation, memory, jnp.asarray(t))
        after, before = (errors_and_rate(transformation, memory, jnp.asarray(t + d))[0][0] for d in (h, -h))
        np.testing.assert_allclose(rate, true_rate, rtol=1e-11, atol=1e-11)
        np.testing.assert_allclose(rate, (after - before) / (2 * h), rtol=1e-6, atol=1e-7)


@EVERY
def test_alpha_rate_is_the_time_derivative_of_alpha(transformation):
    memory = transformation.init(jnp.asarray(0.0), STARTS[0])

    @jax.jit
    def alpha_and_rates(t):
        def alpha(t):
            return along(transformation, memory, t).alpha

        return jax.jvp(alpha, (t,), (jnp.ones_like(t),)), along(transformation, memory, t).alpha_rate

    for t in (0.0, 0.4, 0.9):
        (_, true), rate = alpha_and_rates(t)
        np.testing.assert_allclose(rate, true, rtol=1e-11)


@eqx.filter_jit
def transformed(transformation, start, shares):
    """The transformed errors between the lower bound, 0, and the upper one, 1."""
    memory, t = transformation.init(jnp.asarray(0.0), start), jnp.asarray(0.5)
    envelope = transformation.envelope(t, memory)

    def eps(share):
        e = envelope.lower + share * (envelope.upper - envelope.lower)
        return transformation(t, e, jnp.zeros(2), memory).eps1

    return jax.vmap(eps)(shares)


@every("transformation", ENVELOPED, full=TRANSFORMATIONS_LIKE_OTHERS)
@pytest.mark.parametrize("start", STARTS)
def test_transformed_error_increases_and_diverges_towards_both_bounds(transformation, start):
    grid = np.asarray(
        transformed(transformation, start, jnp.array([1e-12, 1e-6, 0.1, 0.3, 0.7, 0.9, 1 - 1e-6, 1 - 1e-12]))
    )
    assert np.all(np.diff(grid, axis=0) > 0) and np.all(grid[0] < -20) and np.all(grid[-1] > 20)


@EVERY
@pytest.mark.parametrize("start", STARTS)
def test_zero_error_has_a_zero_transformed_error_and_lies_inside_the_envelope(transformation, start):
    memory = transformation.init(jnp.asarray(0.0), start)
    error = transformation(jnp.asarray(0.5), jnp.zeros(2), jnp.zeros(2), memory)
    np.testing.assert_allclose(error.eps1, 0.0, atol=1e-15)
    np.testing.assert_allclose(error.eps2, 0.0, atol=1e-15)
    envelope = transformation.envelope(jnp.asarray(0.5), memory)
    if envelope is not None:
        assert np.all(np.asarray(envelope.lower) < 0) and np.all(np.asarray(envelope.upper) > 0)


@every("transformation", ENVELOPED, full=TRANSFORMATIONS_LIKE_OTHERS)
def test_alpha_is_not_negative_and_beta_exceeds_twice_the_inverse_initial_radius(transformation):
    """Proposition 5, at random errors inside the envelope and at random times."""
    rng = np.random.default_rng(0)
    memory = transformation.init(jnp.asarray(0.0), STARTS[1])

    @jax.jit
    @jax.vmap
    def alpha_beta(t, share):
        envelope = transformation.envelope(t, memory)
        e = envelope.lower + share * (envelope.upper - envelope.lower)
        error = transformation(t, e, jnp.zeros(2), memory)
        return error.alpha, error.beta

    shares = jnp.asarray(rng.uniform(0.001, 0.999, (500, 2)))
    alpha, beta = alpha_beta(jnp.asarray(rng.uniform(0.0, 10.0, 500)), shares)
    assert np.all(np.asarray(alpha) >= 0)
    assert np.all(np.asarray(beta) > 2.0 / np.asarray(transformation.performance.initial))


@EVERY
def test_all_gains_have_finite_gradients_also_at_zero_error(transformation):
    assert all(isinstance(leaf, jax.Array) and leaf.dtype == float for leaf in jax.tree.leaves(transformation))

    @jax.jit
    @jax.grad
    def gradients(transformation, t):
        memory = transformation.init(jnp.asarray(0.0), STARTS[0])
        error = transformation(t, jnp.zeros(2), jnp.zeros(2), memory)
        return sum(jnp.sum(leaf) for leaf in jax.tree.leaves(error))

    for t in (0.0, 1.0, 5.0, 50.0):
        assert_finite(gradients(transformation, jnp.asarray(t)))


@EVERY
def test_a_frame_inverts_its_transformation_and_has_the_right_slope(transformation):
    memory = transformation.init(jnp.asarray(0.0), STARTS[0])
    frame = transformation.frame(jnp.asarray(0.5), jnp.asarray(2e-3), jnp.asarray(3e-3), memory)
    for eps in (jnp.array([0.0, 1e-3]), jnp.array([2.0, -3.0]), jnp.array([-8.0, 6.0])):
        place, slope = frame.psi_and_slope(eps)
        np.testing.assert_allclose(frame.transformed(frame.now * place), eps, rtol=1e-9, atol=1e-14)
        difference = (frame.psi_and_slope(eps + 1e-6)[0] - frame.psi_and_slope(eps - 1e-6)[0]) / 2e-6
        np.testing.assert_allclose(slope, difference, rtol=1e-6, atol=1e-10)


@every("transformation", ENVELOPED, full=TRANSFORMATIONS_LIKE_OTHERS)
@pytest.mark.parametrize("start", STARTS)
def test_a_frame_has_the_led_envelope_and_its_tangent_over_the_horizon(transformation, start):
    memory, t = transformation.init(jnp.asarray(0.0), start), jnp.asarray(0.5)
    lead, horizon = jnp.asarray(2e-3), jnp.asarray(3e-3)
    frame = transformation.frame(t, lead, horizon, memory)

    def upper(t):
        return transformation.envelope(t, memory).upper

    def led(t):
        value, rate = jax.jvp(upper, (t,), (jnp.ones(()),))
        return value + lead * rate

    value, rate = jax.jvp(led, (t,), (jnp.ones(()),))
    np.testing.assert_allclose(frame.now * memory.upper, value, rtol=1e-12)
    np.testing.assert_allclose(frame.ahead * memory.upper, value + horizon * rate, rtol=1e-12)


@EVERY
def test_a_frame_transforms_every_finite_error_to_a_finite_value(transformation):
    memory = transformation.init(jnp.asarray(0.0), STARTS[0])
    frame = transformation.frame(jnp.asarray(0.5), jnp.asarray(2e-3), jnp.asarray(3e-3), memory)
    for y in (0.0, 1e-300, 1.0, -5.0, 1e150, -1e300):
        assert np.all(np.isfinite(frame.transformed(jnp.full(2, y))))
