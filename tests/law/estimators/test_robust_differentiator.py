"""The implicit differentiator: exact, without chattering, of its orders, and a true solution of its own equations."""

import jax.numpy as jnp
import numpy as np
import pytest

from slidax.core.errors import DefinitionError
from slidax.core.types import State
from slidax.law import Estimate, RobustDifferentiator
from slidax.law.estimators import GAINS, _root
from tests.law.estimators.followed import accelerated, followed, predicted, swinging

L0, L1, L2 = GAINS


def step(lipschitz, residual, period=1e-3):
    """The correction of position, velocity and disturbance by one measurement."""
    none = jnp.zeros(1)
    prior = Estimate(state=State(q=none, dq=none), disturbance=none)
    measured = State(q=jnp.array([residual]), dq=none)
    found, _ = RobustDifferentiator(lipschitz)(measured, prior, jnp.asarray(period), jnp.asarray(False), ())
    return float(found.state.q[0]), float(found.state.dq[0]), float(found.disturbance[0])


def test_the_root_solves_its_cubic_to_rounding_over_all_sizes():
    rest = np.logspace(-300, 290, 3001)
    y = np.asarray(_root(jnp.asarray(rest)))
    np.testing.assert_allclose(y**3 + L0 * y**2 + L1 * y, rest, rtol=1e-14)
    np.testing.assert_array_equal(_root(jnp.zeros(2)), 0.0)


@pytest.mark.parametrize("residual", [1e-9, -3e-9, 1e-8, 1e-6, -1e-4, 1e-2, 3.0, -1e5])
@pytest.mark.parametrize("lipschitz", [1.0, 30.0])
@pytest.mark.parametrize("h", [1e-3, 1e-2])
def test_a_step_is_one_of_implicit_euler_of_levants_differentiator(residual, lipschitz, h):
    """In Euler's own states, whose velocity is half a period behind: z0 = q, z1 = dq - h/2 ŵ, z2 = ŵ."""
    q, dq, disturbance = step(lipschitz, residual, h)
    z0, z1, z2 = q, dq - h / 2 * disturbance, disturbance
    error = z0 - residual
    root = np.cbrt(abs(error)) * np.sign(error)
    if abs(error) > 1e-12 * abs(residual):
        sign = np.sign(error)
    else:
        root, sign = 0.0, -z2 / (h * L2 * lipschitz)
        assert abs(sign) <= 1.0
    tolerance = 1e-6 * abs(residual)
    np.testing.assert_allclose(z2, -h * L2 * lipschitz * sign, rtol=1e-9)
    np.testing.assert_allclose(z1, h * z2 - h * L1 * lipschitz ** (2 / 3) * root, atol=tolerance / h)
    np.testing.assert_allclose(z0, h * z1 - h * L0 * lipschitz ** (1 / 3) * root * abs(root), atol=tolerance)


def test_within_the_selection_of_the_sign_the_measured_position_is_believed():
    h, lipschitz = 1e-3, 7.0
    edge = L2 * lipschitz * h**3
    for share in (-1.0, -0.5, 0.25, 0.99):
        q, dq, disturbance = step(lipschitz, share * edge, h)
        np.testing.assert_allclose([q, dq, disturbance], share * edge * np.array([1, 1.5 / h, 1 / h**2]), rtol=1e-12)
    assert 0 < step(lipschitz, 1.01 * edge, h)[0] < 1.01 * edge


@pytest.mark.full
def test_a_correction_grows_with_its_residual_and_is_odd():
    residuals = np.logspace(-12, 3, 400)
    steps = np.array([step(5.0, residual) for residual in residuals])
    assert np.all(np.diff(steps[:, :2], axis=0) > 0) and np.all(np.diff(steps[:, 2]) >= 0)
    np.testing.assert_array_equal(step(5.0, -1e-6), -np.array(step(5.0, 1e-6)))


def test_the_push_changes_no_faster_than_its_bound():
    np.testing.assert_allclose(step(5.0, 1e3)[2], L2 * 5.0 * 1e-3, rtol=1e-12)


def test_small_errors_are_gone_after_three_samples():
    """All three of them: the estimate is that whose error dies at once, as long as the disturbance may explain it."""
    true = accelerated(jnp.array([4.0, -0.5]))
    estimator, period = RobustDifferentiator(1e5), jnp.asarray(1e-3)
    start = true(jnp.zeros(()))
    last = Estimate(state=State(q=start.q + 1e-6, dq=start.dq - 1e-3), disturbance=jnp.zeros(2))
    for k in range(1, 4):
        found, _ = estimator(true(k * period), predicted(last, period), period, jnp.asarray(False), ())
        last = found
    np.testing.assert_allclose(last.disturbance, [4.0, -0.5], atol=1e-7)
    np.testing.assert_allclose(last.state.dq, true(3 * period).dq, atol=1e-10)


@pytest.mark.parametrize("period", [1e-3, 1e-2, 1e-1])
def test_a_constant_push_is_found_in_finite_time_and_kept_without_chattering(period):
    """In about 1.7 times its size over L; rounding of the position over h² is all that is left."""
    samples = round(8.0 / period)
    found = np.asarray(
        followed(RobustDifferentiator(4.0), accelerated(jnp.array([4.0, -0.5])), samples, period).disturbance
    )
    late = np.arange(1, samples + 1) * period > 2.0
    np.testing.assert_allclose(found[late], np.tile([4.0, -0.5], (np.sum(late), 1)), atol=1e-13 / period**2 + 1e-10)


@pytest.mark.parametrize("lipschitz", [1.0, 3.0, 100.0])
def test_a_push_whose_rate_is_bounded_is_followed_exactly_but_for_the_sampling(lipschitz):
    """The disturbance is a period behind, and the velocity is off by a third of `h²` times its rate, for any bound."""
    errors = []
    for period in (0.02, 0.01):
        samples = round(8.0 / period)
        found = followed(RobustDifferentiator(lipschitz), swinging, samples, period)
        times = np.arange(1, samples + 1)[:, None] * period
        q = np.concatenate([np.sin(times), np.cos(times)], axis=1)
        dq = np.concatenate([np.cos(times), -np.sin(times)], axis=1)
        late = times[:, 0] > 4.0
        np.testing.assert_array_less(np.abs(found.state.q - q)[late], 1e-14)
        errors.append([np.max(np.abs(a - b)[late]) for a, b in ((found.state.dq, dq), (found.disturbance, -q))])
        np.testing.assert_allclose(errors[-1], [period**2 / 3, period], rtol=0.01)
    np.testing.assert_allclose(np.log2(np.array(errors[0]) / errors[1]), [2.0, 1.0], atol=0.01)


def test_noise_is_bounded_in_its_effect_and_gentler_with_a_smaller_bound():
    """Levant's accuracy: errors of the velocity as the power 2/3 of the noise, of the disturbance as the power 1/3."""
    rng = np.random.default_rng(0)
    rough, errors = jnp.asarray(rng.uniform(-1.0, 1.0, (8000, 2))), []
    right = np.stack([np.cos(np.arange(1, 8001) * 1e-3), -np.sin(np.arange(1, 8001) * 1e-3)], axis=1)
    for size in (1e-6, 1e-3):
        found = followed(RobustDifferentiator(1.0), swinging, 8000, noise=size * rough)
        off = np.abs(np.asarray(found.state.dq) - right)[4000:]
        errors.append(np.max(off))
        assert np.max(off) < 5.0 * size ** (2 / 3)
    assert 30.0 < errors[1] / errors[0] < 300.0
    wild = followed(RobustDifferentiator(100.0), swinging, 8000, noise=1e-3 * rough)
    assert np.max(np.abs(np.asarray(wild.state.dq) - right)[4000:]) > 2.0 * errors[1]


@pytest.mark.parametrize("value", [0.0, [1.0, -1.0], float("inf")])
def test_a_bound_that_cannot_be_is_refused(value):
    with pytest.raises(DefinitionError, match=r"`RobustDifferentiator\.lipschitz` must be > 0"):
        RobustDifferentiator(value)
