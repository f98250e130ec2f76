"""Every reaching law has a term along s that vanishes with s, and a direction with a norm of at most 1."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from slidax.core import matvec
from slidax.core.errors import DefinitionError
from slidax.core.types import State
from slidax.law import FixedTimeReaching, SaturatedReaching
from tests.enrolled import assert_finite, every
from tests.law.members import BOUNDS, REACHING, REACHING_LIKE_OTHERS

S = jnp.asarray(np.random.default_rng(0).normal(size=(200, 2)) * np.logspace(-6, 2, 200)[:, None])
EVERY = every("reaching", REACHING, full=REACHING_LIKE_OTHERS)


@eqx.filter_jit
def terms(reaching, s):
    """The continuous term and the direction at each of the s."""
    return jax.vmap(reaching.continuous_term)(s), jax.vmap(reaching.switching_direction)(s)


@EVERY
def test_continuous_term_and_switching_direction_point_along_s_and_are_odd(reaching):
    for pushed, opposite in zip(terms(reaching, S), terms(reaching, -S), strict=True):
        assert np.all(np.sum(np.asarray(S) * np.asarray(pushed), axis=1) > 0)
        np.testing.assert_allclose(opposite, -pushed, rtol=1e-13)


# Saturated reaching acts on each joint separately, so its direction is not that of s.
PARALLEL = [(name, member) for name, member in REACHING if not isinstance(member, SaturatedReaching)]
# A full matrix times Sig^r is not monotone, so that law has no implicit step.
IMPLICIT = [(name, member) for name, member in REACHING if getattr(member, "gain", jnp.zeros(())).ndim < 2]


@EVERY
def test_switching_direction_has_a_norm_of_at_most_1(reaching):
    direction = np.asarray(terms(reaching, S)[1])
    assert np.all(np.linalg.norm(direction, axis=1) <= 1 + 1e-15)


@every("reaching", PARALLEL, full=REACHING_LIKE_OTHERS)
def test_switching_direction_is_parallel_to_s(reaching):
    direction = np.asarray(terms(reaching, S)[1])
    cross = direction[:, 0] * np.asarray(S)[:, 1] - direction[:, 1] * np.asarray(S)[:, 0]
    np.testing.assert_allclose(cross, 0.0, atol=1e-14 * np.linalg.norm(S, axis=1).max())


@EVERY
def test_continuous_term_and_switching_direction_vanish_at_zero_with_finite_gradients(reaching):
    assert all(isinstance(leaf, jax.Array) and leaf.dtype == float for leaf in jax.tree.leaves(reaching))
    for name in ("continuous_term", "switching_direction"):

        def total(reaching, s, name=name):
            return jnp.sum(getattr(reaching, name)(s))

        np.testing.assert_array_equal(getattr(reaching, name)(jnp.zeros(2)), 0.0)
        assert_finite(jax.jit(jax.grad(total, argnums=(0, 1)))(reaching, jnp.zeros(2)))


CASES = 400
CHANCE = np.random.default_rng(1)
FACTORS = CHANCE.normal(size=(CASES, 2, 2))
METRICS = jnp.asarray(
    (FACTORS @ FACTORS.transpose(0, 2, 1) + 0.05 * np.eye(2)) * 10 ** CHANCE.uniform(1, 5, size=(CASES, 1, 1))
)
STARTS = jnp.asarray(CHANCE.normal(size=(CASES, 2)) * 10 ** CHANCE.uniform(-8, 1, size=(CASES, 1)))
SIZES = jnp.asarray(10 ** CHANCE.uniform(-1, 3, size=CASES))


@eqx.filter_jit
def steps(reaching, metric, s, u):
    return jax.vmap(reaching.implicit)(metric, s, u)


def implicit(reaching, s=STARTS):
    return np.asarray(steps(reaching, METRICS, s, SIZES))


@every("reaching", IMPLICIT, full=REACHING_LIKE_OTHERS)
def test_the_implicit_step_solves_its_equation_in_every_case(reaching):
    """`A (s⁺ - s) + P(s⁺) ∈ -u N(s⁺)`: to 1e-12 where N is single-valued, within its set where it is not."""
    after = implicit(reaching)
    push = np.asarray(jax.vmap(matvec)(METRICS, STARTS))
    continuous, direction = terms(reaching, jnp.asarray(after))
    rest = push - np.asarray(jax.vmap(matvec)(METRICS, after) + continuous)
    allowed = 1e-12 * (1 + np.linalg.norm(push, axis=1))
    if isinstance(reaching, SaturatedReaching):
        limit = np.asarray(SIZES)[:, None] * np.broadcast_to(reaching.weights, (2,))
        free = (after != 0) | (np.asarray(reaching.layer) > 0)
        wanted = np.asarray(SIZES)[:, None] * np.asarray(direction)
        assert np.all(np.where(free, np.abs(rest - wanted), 0.0) <= allowed[:, None])
        assert np.all(np.where(free, 0.0, np.abs(rest) - limit) <= allowed[:, None])
        return
    stuck = np.all(after == 0, axis=1)
    wanted = np.asarray(SIZES)[:, None] * np.asarray(direction)
    left = np.linalg.norm(rest - wanted, axis=1)
    assert np.all(left[~stuck] <= allowed[~stuck])
    assert np.all(np.linalg.norm(rest[stuck], axis=1) <= np.asarray(SIZES)[stuck])


@every("reaching", IMPLICIT, full=REACHING_LIKE_OTHERS)
def test_the_implicit_step_is_zero_exactly_where_u_can_bring_s_to_zero(reaching):
    np.testing.assert_array_equal(implicit(reaching, s=0.0 * STARTS), 0.0)
    stuck = np.all(implicit(reaching) == 0, axis=1)
    if np.any(np.asarray(reaching.layer) > 0):
        # Inside a boundary layer the torque falls with s, so that it brings no other s to zero.
        assert not stuck.any()
        return
    push = np.asarray(jax.vmap(matvec)(METRICS, STARTS))
    if isinstance(reaching, SaturatedReaching):
        held = np.all(np.abs(push) <= np.asarray(SIZES)[:, None] * np.asarray(reaching.weights), axis=1)
    else:
        held = np.linalg.norm(push, axis=1) <= np.asarray(SIZES)
    np.testing.assert_array_equal(stuck, held)
    assert 50 < stuck.sum() < 350


@every("reaching", IMPLICIT, full=REACHING_LIKE_OTHERS)
def test_the_implicit_step_never_increases_a_distance_in_the_metric(reaching):
    """The resolvent of a monotone map is nonexpansive: no step can overshoot."""
    first, second = implicit(reaching), implicit(reaching, s=-0.7 * STARTS[::-1])
    before = np.asarray(STARTS + 0.7 * STARTS[::-1])
    after = first - second

    def squared(x):
        return np.einsum("ki,kij,kj->k", x, np.asarray(METRICS), x)

    assert np.all(squared(after) <= squared(before) * (1 + 1e-9) + 1e-18)


@eqx.filter_jit
def slopes(reaching, metric, s, u):
    """Derivatives of one step by s, u and the parameters of the law, for both components."""
    return jax.jacrev(lambda law, s, u: law.implicit(metric, s, u), argnums=(1, 2, 0))(reaching, s, u)


@every("reaching", IMPLICIT, full=REACHING_LIKE_OTHERS)
def test_the_derivative_of_the_implicit_step_is_that_of_the_solution(reaching):
    """Against differences, away from the kinks, where the one-sided derivatives differ."""
    metric, s, u = jnp.array([[300.0, 40.0], [40.0, 200.0]]), jnp.array([0.5, -0.4]), jnp.asarray(20.0)
    slope_s, slope_u, gradient = slopes(reaching, metric, s, u)
    ds, du = 1e-5 * jnp.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0], [0.0, 0.0], [0.0, 0.0]]), 1e-4
    shifted = steps(reaching, jnp.stack([metric] * 6), s + ds, u + du * jnp.array([0.0, 0.0, 0.0, 0.0, 1.0, -1.0]))
    by_s, by_s_too, by_u = np.asarray(shifted[::2] - shifted[1::2])
    np.testing.assert_allclose(slope_s, np.stack([by_s, by_s_too], axis=1) / 2e-5, rtol=1e-6, atol=1e-8)
    np.testing.assert_allclose(slope_u, by_u / 2e-4, rtol=1e-6, atol=1e-9)
    assert_finite(gradient)


def test_a_full_gain_matrix_has_no_implicit_step():
    with pytest.raises(DefinitionError, match="must be one number or a diagonal"):
        FixedTimeReaching([[0.2, 0.1], [0.1, 0.4]], 1.2).implicit(METRICS[0], STARTS[0], SIZES[0])


@every("bound", BOUNDS)
def test_a_torque_bound_is_a_positive_scalar_that_is_least_at_rest_without_torque(bound):
    """Its derivatives are finite at rest without torque, and its compiled value is the same."""
    rest = State(q=jnp.zeros(2), dq=jnp.zeros(2))
    least = bound(rest, jnp.zeros(2))
    assert least.shape == () and least > 0
    compiled = eqx.filter_jit(type(bound).__call__)
    for q, dq, tau in np.random.default_rng(0).normal(size=(50, 3, 2)) * [[1.0], [2.0], [50.0]]:
        state = State(q=jnp.asarray(q), dq=jnp.asarray(dq))
        u = bound(state, jnp.asarray(tau))
        assert u >= least
        np.testing.assert_allclose(compiled(bound, state, jnp.asarray(tau)), u, rtol=1e-14)
    assert_finite(jax.grad(lambda bound, state, tau: bound(state, tau), argnums=(0, 1, 2))(bound, rest, jnp.zeros(2)))
