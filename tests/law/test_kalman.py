"""Gains of the Kalman filter against a general solver, and their effect against their definition."""

import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.linalg import solve_discrete_are

from slidax.core.errors import DefinitionError
from slidax.core.types import State
from slidax.law import Estimate, Kalman, StrongTracking, sampled_data
from slidax.law.kalman import ALERT_TIME, BUDGET, FASTEST_GROWN, SURPRISE, TrackingMemory
from slidax.plant import Encoders
from slidax.simulation import Plant, simulate, simulate_batch
from tests.law.followed import followed
from tests.paper_examples import MOTION_4_1, START_4_1, TWO_LINK, law_4_1
from tests.simulation.simple import SMOOTH_PLANT

CASES = np.array(list(itertools.product(np.logspace(-4, 4, 5), [1e-6, 1e-5, 1e-4, 1e-3])))
"""Densities and resolutions."""


def system(density, period):
    """The discrete triple integrator, and the covariance that white noise on the third derivative gives it."""
    h = period
    moved = np.array([[1, h, h**2 / 2], [0, 1, h], [0, 0, 1]])
    drift = np.array([[h**5 / 20, h**4 / 8, h**3 / 6], [h**4 / 8, h**3 / 3, h**2 / 2], [h**3 / 6, h**2 / 2, h]])
    return moved, density * drift


def general(density, variance, period):
    """Gains by scipy, in well-scaled units: the filter's time constant and the measurement's standard deviation."""
    time = max((variance * period / density) ** (1 / 6), period)
    units = np.sqrt(variance) * np.array([1.0, 1 / time, 1 / time**2])
    moved, drift = system(density, period)
    moved, drift = moved * units[None, :] / units[:, None], drift / np.outer(units, units)
    covariance = solve_discrete_are(moved.T, np.array([[1.0], [0.0], [0.0]]), drift, np.eye(1))
    return covariance[:, 0] / (covariance[0, 0] + 1.0) * units / units[0]


@pytest.mark.parametrize("period", [1e-4, 1e-3, 1e-2])
def test_the_steady_gains_agree_with_a_general_riccati_solver(period):
    """Each case is a joint of one filter."""
    densities, variances = CASES[:, 0], CASES[:, 1] ** 2 / 12
    gains = Kalman.steady(density=densities, variance=variances, period=period).gains
    wanted = [general(*case, period) for case in zip(densities, variances, strict=True)]
    np.testing.assert_allclose(gains, np.transpose(wanted), rtol=1e-8)


def test_the_steady_gains_are_the_limit_of_the_covariance_recursion():
    """Iterates the covariance recursion from a large initial covariance."""
    density, variance, period = 10.0, 1e-10 / 12, 1e-3
    moved, drift = system(density, period)
    covariance = np.diag([1e-8, 1e-2, 1e2])
    for _ in range(3000):
        gains = covariance[:, 0] / (covariance[0, 0] + variance)
        covariance = covariance - np.outer(gains, covariance[0])
        covariance = moved @ covariance @ moved.T + drift
    steady = Kalman.steady(density=density, variance=variance, period=period).gains
    np.testing.assert_allclose(steady, gains, rtol=1e-9)


@pytest.mark.parametrize("power", [-80, -40, -20, 0, 20, 80])
def test_the_filter_is_stable_for_any_bandwidth(power):
    gains = np.asarray(Kalman.steady(density=10.0**power, variance=1.0, period=1.0).gains)
    moved = system(1.0, 1.0)[0]
    errors = (np.eye(3) - np.outer(gains, [1.0, 0.0, 0.0])) @ moved
    assert np.all(np.isfinite(gains)) and np.all(gains > 0) and np.max(np.abs(np.linalg.eigvals(errors))) < 1.0


def test_position_gain_is_1_where_measurement_noise_is_negligible():
    gains = np.asarray(Kalman.steady(density=1e20, variance=1.0, period=1.0).gains)
    np.testing.assert_allclose(gains[0], 1.0, rtol=1e-12)


@pytest.mark.full
def test_gains_can_be_computed_and_differentiated_inside_jit():
    def gains(density):
        return Kalman.steady(density=density, variance=1e-10, period=1e-3).gains

    unity = jnp.asarray(1.0)
    step = 1e-5
    slopes = (np.asarray(gains(1.0 + step)) - np.asarray(gains(1.0 - step))) / (2 * step)
    value, forward, reverse = jax.jit(lambda x: (gains(x), jax.jacfwd(gains)(x), jax.jacrev(gains)(x)))(unity)
    np.testing.assert_allclose(value, gains(1.0), rtol=1e-12)
    np.testing.assert_allclose(forward, slopes, rtol=1e-6)
    np.testing.assert_allclose(reverse, slopes, rtol=1e-6)


def test_a_residual_corrects_the_estimate_by_the_gains():
    none = jnp.zeros(2)
    prior = Estimate(state=State(q=jnp.array([1.0, 2.0]), dq=none), disturbance=jnp.ones(2))
    measured = State(q=jnp.array([1.1, 1.8]), dq=none)
    kalman = Kalman([[0.5, 0.25], [10.0, 20.0], [100.0, 300.0]])
    estimate, _ = kalman(measured, prior, jnp.asarray(1e-3), jnp.asarray(False), kalman.init(measured))
    np.testing.assert_allclose(estimate.state.q, [1.05, 1.95], rtol=1e-12)
    np.testing.assert_allclose(estimate.state.dq, [1.0, -4.0], rtol=1e-12)
    np.testing.assert_allclose(estimate.disturbance, [11.0, -59.0], rtol=1e-12)


def test_scaled_steady_gains_estimate_a_drifting_disturbance_less_accurately():
    """The noise is that for which the gains were computed."""
    density, deviation, period, samples = 4.0, 1e-5, 1e-3, 20_000
    rng = np.random.default_rng(0)
    moved, drift = system(density, period)
    noise = rng.multivariate_normal(np.zeros(3), drift / np.diag(drift).max(), size=samples) * np.sqrt(drift[2, 2])
    x, q = np.zeros(3), np.zeros(samples + 1)
    disturbance = np.zeros(samples + 1)
    for k in range(samples):
        x = moved @ x + noise[k]
        q[k + 1], disturbance[k + 1] = x[0], x[2]
    measured = jnp.asarray(q + deviation * rng.normal(size=samples + 1))

    def motion(t):
        k = jnp.round(t / period).astype(int)
        return State(q=measured[k][None], dq=jnp.zeros(1))

    best = Kalman.steady(density=density, variance=deviation**2, period=period).gains

    def error(factor):
        least = followed(Kalman(factor * best), motion, samples, period).disturbance[:, 0]
        return float(jnp.sqrt(jnp.mean((least - disturbance[1:])[2000:] ** 2)))

    least = error(1.0)
    for factor in ([0.5, 0.5, 0.5], [2.0, 2.0, 2.0], [1.0, 1.0, 0.3], [1.0, 1.0, 2.0]):
        assert error(jnp.array(factor)) > least


@pytest.mark.parametrize("gains", [[1.0, 2.0], [[1.0, 2.0, 3.0]], 1.0, [[[1.0]], [[1.0]], [[1.0]]], [0.5, -1.0, 2.0]])
def test_gains_of_wrong_shape_or_sign_are_refused(gains):
    rule = ">= 0" if np.shape(gains) == (3,) else "three numbers or three per joint; got shape"
    with pytest.raises(DefinitionError, match=rf"`Kalman\.gains` must be {rule}"):
        Kalman(gains)


@pytest.mark.parametrize("field", ["density", "variance", "period"])
@pytest.mark.parametrize("value", [0.0, -1.0, float("nan"), float("inf")])
def test_noise_and_period_that_are_not_positive_and_finite_are_refused(field, value):
    with pytest.raises(DefinitionError, match=f"`{field}` of a Kalman filter must be > 0"):
        Kalman.steady(**({"density": 1.0, "variance": 1e-10, "period": 1e-3} | {field: value}))


MASS = jnp.array([[4.0, 1.5], [1.5, 2.0]])


@pytest.mark.parametrize("torque_density", [0.3, [0.3, 0.7]])
def test_gains_of_an_arm_follow_from_torque_drift_and_joint_inertia(torque_density):
    """A torque on a joint of inertia M is an acceleration of 1/M, and a density is that of its square."""
    kalman = Kalman.of_arm(MASS, variance=1e-11, period=1e-3, torque_density=torque_density)
    by_hand = np.broadcast_to(torque_density, 2) / np.array([16.0, 4.0])
    right = [general(density, 1e-11, 1e-3) for density in by_hand]
    np.testing.assert_allclose(kalman.gains, np.transpose(right), rtol=1e-8)


def test_the_default_torque_drift_is_0_2_newton_metres_in_a_second():
    """Its spectral density is 0.05 (N m/s)² s, with the standard deviation √0.05 N m in a second."""
    kalman = Kalman.of_arm(MASS, variance=[1e-11, 1e-12], period=2e-3)
    right = [general(0.05 / m**2, v, 2e-3) for m, v in ((4.0, 1e-11), (2.0, 1e-12))]
    np.testing.assert_allclose(kalman.gains, np.transpose(right), rtol=1e-8)


@pytest.mark.parametrize("value", [0.0, [0.1, -1.0], float("nan"), float("inf")])
def test_a_torque_drift_that_is_not_positive_and_finite_is_refused(value):
    with pytest.raises(DefinitionError, match=r"`torque_density` of a Kalman filter must be > 0 \(N m/s\)² s"):
        Kalman.of_arm(MASS, variance=1e-11, period=1e-3, torque_density=value)


def test_the_velocity_after_a_long_gap_is_exact_for_a_constant_disturbance_error():
    kalman, elapsed = Kalman.steady(density=1.0, variance=1e-11, period=1e-3), jnp.asarray(0.4)
    assert float(kalman.gains[1]) * 0.4 > 2.0
    disturbance = jnp.array([3.0, -1.0])
    measured = State(q=0.5 * disturbance * elapsed**2, dq=disturbance * elapsed)
    prior = Estimate(state=State(q=jnp.zeros(2), dq=jnp.zeros(2)), disturbance=jnp.zeros(2))
    estimate, _ = kalman(measured, prior, elapsed, jnp.asarray(True), ())
    np.testing.assert_allclose(estimate.state.dq, measured.dq, rtol=1e-12)
    np.testing.assert_array_equal(estimate.state.q, measured.q)


def test_the_velocity_correction_after_a_short_gap_is_unchanged():
    kalman = Kalman.steady(density=1e-3, variance=1e-11, period=1e-3)
    measured = State(q=jnp.full(2, 1e-5), dq=jnp.zeros(2))
    prior = Estimate(state=State(q=jnp.zeros(2), dq=jnp.zeros(2)), disturbance=jnp.zeros(2))
    usual, _ = kalman(measured, prior, jnp.asarray(1e-3), jnp.asarray(False), ())
    estimate, _ = kalman(measured, prior, jnp.asarray(2e-3), jnp.asarray(True), ())
    np.testing.assert_array_equal(estimate.state.dq, usual.state.dq)


@pytest.mark.full
def test_the_filter_of_an_arm_can_be_batched_and_differentiated_by_its_torque_density():
    def gains(density):
        return Kalman.of_arm(MASS, variance=1e-11, period=1e-3, torque_density=density).gains

    densities, h = jnp.array([0.01, 0.05, 2.0]), 1e-5
    value_and_slopes = jax.jit(lambda density: (gains(density), jax.jacfwd(gains)(density), jax.jacrev(gains)(density)))
    for density, many in zip(densities, jax.jit(jax.vmap(gains))(densities), strict=True):
        value, forward, reverse = value_and_slopes(density)
        np.testing.assert_allclose(value, gains(density), rtol=1e-12)
        np.testing.assert_allclose(many, value, rtol=1e-12)
        up, down = (value_and_slopes(density * factor)[0] for factor in (1 + h, 1 - h))
        difference = (up - down) / (2 * h * density)
        np.testing.assert_allclose(forward, difference, rtol=1e-7)
        np.testing.assert_allclose(reverse, difference, rtol=1e-7)


def test_a_native_batch_over_the_torque_density_equals_single_runs():
    def parts(density):
        kalman = Kalman.of_arm(MASS, variance=1e-11, period=1e-3, torque_density=density)
        law = sampled_data(law_4_1(), period=1e-3, estimator=kalman)
        return Plant(TWO_LINK, SMOOTH_PLANT.disturbance, Encoders(1e-5)), law, MOTION_4_1, START_4_1

    densities, how = jnp.array([0.01, 0.2]), {"t1": 0.05, "period": 1e-3, "log_every": None, "engine": "native"}
    many = simulate_batch(parts, densities, **how).state.q
    assert np.all(np.abs(many[0] - many[1]) > 1e-7)
    for state, density in zip(many, densities, strict=True):
        np.testing.assert_allclose(state, simulate(*parts(density), **how).state.q, rtol=1e-12)


DENSITY, PERIOD = 0.02, 1e-3


def filter_of(inertia, resolution):
    return Kalman.of_arm(np.diag([inertia]), variance=resolution**2 / 12, period=PERIOD, torque_density=DENSITY)


# A filter combined with an adaptation assumes encoders of the finest resolution.
@pytest.mark.parametrize(("resolution", "off"), [(1e-4, 1e-5), (1e-5, 1e-4), (2e-6, 1e-2)])
@pytest.mark.parametrize("inertia", [0.02, 0.05, 0.3, 1.0])
def test_gains_follow_a_changed_inertia(resolution, off, inertia):
    followed = filter_of(0.1, resolution).for_inertia(jnp.array([inertia]))
    np.testing.assert_allclose(followed.gains, filter_of(inertia, resolution).gains, rtol=off)
    np.testing.assert_allclose(followed.pace, filter_of(inertia, resolution).pace, rtol=1e-12)


def test_a_filter_without_an_inertia_is_unchanged_by_for_inertia():
    filter_ = Kalman.steady(density=1.0, variance=1e-11, period=PERIOD)
    assert filter_.for_inertia(jnp.array([3.0])) is filter_


DEVIATION = 3e-6


def tracking(growth=2.0, inertia=1.0, share=1.0):
    """A filter whose bandwidth may grow, of one joint."""
    return StrongTracking(filter_of(inertia, 1e-5), [DEVIATION], growth, share)


def corrected(estimator, innovation, before=None, beyond=0.0, spent=0.0):
    """The change of q, q̇ and ŵ by an innovation [rad], and `p - 1` after it.

    - `before`: sum of the earlier innovations [rad]; twice `innovation` if None.
    """
    zero = jnp.zeros(1)
    measured = State(q=jnp.array([innovation]), dq=zero)
    args = measured, Estimate(State(zero, zero), zero), jnp.asarray(PERIOD), jnp.asarray(False)
    last = (2.0 * innovation if before is None else before) / DEVIATION
    memory = TrackingMemory(jnp.array([beyond]), jnp.array([last]), jnp.array([spent]))
    estimate, after = estimator(*args, memory if isinstance(estimator, StrongTracking) else ())
    change = np.array([*estimate.state.q, *estimate.state.dq, *estimate.disturbance])
    return change, float(after.growth[0]) if isinstance(estimator, StrongTracking) else 0.0


def usual_change(innovation, inertia=1.0):
    return corrected(filter_of(inertia, 1e-5), innovation)[0]


def test_small_or_single_large_innovations_do_not_raise_the_bandwidth():
    large, small = 50.0 * DEVIATION, 0.99 * SURPRISE * DEVIATION
    for innovation, before in ((small, small), (large, small), (small, large), (large, -large), (-large, large)):
        change, beyond = corrected(tracking(), innovation, before)
        np.testing.assert_array_equal(change, usual_change(innovation))
        assert beyond == 0.0


def test_innovations_after_an_outlier_do_not_raise_the_bandwidth():
    filter_, zero, wrong = tracking(growth=3.0), jnp.zeros(1), 200.0
    memory = filter_.init(State(zero, zero))
    for innovation in (1.0, wrong, -30.0, -20.0, -15.0, -10.0, -6.0):
        measured = State(q=jnp.array([innovation * DEVIATION]), dq=zero)
        _, memory = filter_(
            measured, Estimate(State(zero, zero), zero), jnp.asarray(PERIOD), jnp.asarray(False), memory
        )
        assert memory.growth[0] == 0.0


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_two_large_innovations_of_equal_sign_give_the_gains_of_a_faster_filter(sign):
    large = sign * 50.0 * DEVIATION
    np.testing.assert_allclose(filter_of(2.0**-3, 1e-5).pace, 2.0 * filter_of(1.0, 1e-5).pace)
    change, beyond = corrected(tracking(), large)
    np.testing.assert_allclose(change, usual_change(large, 2.0**-3), rtol=1e-3)
    assert beyond == 1.0
    less = sign * (SURPRISE + 0.4) * DEVIATION * np.exp(PERIOD / ALERT_TIME)
    change, beyond = corrected(tracking(), large, less)
    np.testing.assert_allclose(beyond, 0.4, rtol=1e-9)
    np.testing.assert_allclose(change, usual_change(large, 1.4**-3), rtol=1e-3)


def test_the_raised_bandwidth_decays_with_its_time_constant():
    filter_, beyond = tracking(), 1.0
    for _ in range(round(ALERT_TIME / PERIOD)):
        beyond = corrected(filter_, DEVIATION, beyond=beyond)[1]
    np.testing.assert_allclose(beyond, np.exp(-1.0), rtol=1e-12)


def test_the_bandwidth_rises_no_further_once_its_budget_is_spent():
    large = 50.0 * DEVIATION
    np.testing.assert_array_equal(corrected(tracking(), large, spent=0.99 * BUDGET)[0], corrected(tracking(), large)[0])
    half = corrected(tracking(), large, spent=1.5 * BUDGET)[0]
    np.testing.assert_allclose(half, usual_change(large, 1.5**-3), rtol=1e-3)
    np.testing.assert_array_equal(corrected(tracking(), large, spent=2.0 * BUDGET)[0], usual_change(large))


def test_the_bandwidth_does_not_rise_with_share_zero_or_in_a_fast_filter():
    for filter_ in (tracking(share=0.0), tracking().with_share(jnp.zeros(()))):
        np.testing.assert_array_equal(corrected(filter_, 1e-3)[0], usual_change(1e-3))
    assert filter_of(1e-3, 1e-5).pace[0] > FASTEST_GROWN
    np.testing.assert_array_equal(corrected(tracking(inertia=1e-3), 1e-3)[0], usual_change(1e-3, 1e-3))


def test_strong_tracking_estimates_a_sudden_disturbance_in_under_75_percent_of_the_time():
    def motion(t):
        return State(q=0.5 * jnp.maximum(t - 0.1, 0.0) ** 2 * jnp.ones(1), dq=jnp.maximum(t - 0.1, 0.0) * jnp.ones(1))

    times = []
    for estimator in (filter_of(1.0, 1e-5), tracking(growth=3.0)):
        disturbance = np.asarray(followed(estimator, motion, 300).disturbance)[:, 0]
        times.append(np.argmax(disturbance > 0.5) - 100)
    assert times[1] < 0.75 * times[0]


def test_strong_tracking_refuses_a_filter_that_is_not_of_an_arm():
    with pytest.raises(DefinitionError, match=r"construct it by `Kalman\.of_arm`"):
        StrongTracking(Kalman.steady(density=1.0, variance=1e-11, period=PERIOD), [DEVIATION])
