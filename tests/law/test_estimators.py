"""Estimators against their formulas: measured velocity, filtered difference, robust differentiator."""

import jax.numpy as jnp
import numpy as np
import pytest

from slidax.core.errors import DefinitionError
from slidax.core.types import State
from slidax.law import Estimate, FilteredDifference, Measured, RobustDifferentiator
from slidax.law.estimators import GAINS, _root
from tests.law.followed import accelerated, followed, predicted, swinging

PUSH = np.array([4.0, -0.5])


def errors_decay(cutoff, gain, period):
    """Recursion matrix for the errors of the velocity and of the disturbance times h, derived by hand."""
    a = 1 - np.exp(-cutoff * period)
    return np.array([[1 - a, 1 - a / 2], [-gain * a**2, 1 - gain * a**2 / 2]])


def test_the_velocity_prediction_error_drives_the_disturbance_estimate():
    none = jnp.zeros(2)
    prior = Estimate(state=State(q=none, dq=jnp.array([1.0, 2.0])), disturbance=jnp.array([0.5, -0.5]))
    measured = State(q=jnp.array([0.1, 0.2]), dq=jnp.array([1.01, 1.98]))
    estimator = Measured([0.5, 0.25])
    estimate, _ = estimator(measured, prior, jnp.asarray(0.01), jnp.asarray(False), estimator.init(measured))
    np.testing.assert_array_equal(estimate.state.q, measured.q)
    np.testing.assert_array_equal(estimate.state.dq, measured.dq)
    np.testing.assert_allclose(estimate.disturbance, [1.0, -1.0], rtol=1e-10)


@pytest.mark.parametrize("gain", [0.1, 0.5, 1.0])
def test_disturbance_estimate_converges_geometrically_at_its_gain(gain):
    estimate = np.asarray(followed(Measured(gain), accelerated(jnp.asarray(PUSH)), 30).disturbance)
    left = (1 - gain) ** np.arange(1, 31)
    np.testing.assert_allclose(estimate, PUSH * (1 - left[:, None]), atol=1e-9)


def growing(t):
    """A motion whose disturbance is `PUSH t`: it grows linearly."""
    return State(q=jnp.array([0.1, 0.2]) + PUSH * t**3 / 6, dq=PUSH * t**2 / 2)


@pytest.mark.parametrize("ahead", [0.0, 1.0, 2.0, 2.5])
@pytest.mark.parametrize("make", [lambda ahead: Measured.critical(0.3, ahead), lambda ahead: Measured(0.5, 0.2, ahead)])
def test_a_linearly_growing_disturbance_is_compensated_without_lag(make, ahead):
    """The estimate is the disturbance `ahead` periods after the middle of the last period."""
    estimate = np.asarray(followed(make(ahead), growing, 400).disturbance)
    times = np.arange(1, 401)[:, None] * 1e-3
    np.testing.assert_allclose(estimate[200:], (PUSH * (times + (ahead - 0.5) * 1e-3))[200:], rtol=1e-9)


@pytest.mark.parametrize("gain", [0.2, 0.5])
def test_an_estimate_without_a_trend_lags_behind_a_growing_disturbance(gain):
    estimate = np.asarray(followed(Measured(gain), growing, 400).disturbance)
    times = np.arange(1, 401)[:, None] * 1e-3
    lag = (0.5 + (1 - gain) / gain) * 1e-3
    np.testing.assert_allclose(estimate[200:], (PUSH * (times - lag))[200:], rtol=1e-9)


@pytest.mark.parametrize("gain", [0.05, 0.3, 0.9])
def test_the_critical_trend_makes_both_poles_equal(gain):
    """The error for a constant disturbance is `(1 - (1 - p) k) pᵏ` with `p = √(1 - g)`: it crosses zero once."""
    estimate = np.asarray(followed(Measured.critical(gain, 0.0), accelerated(jnp.asarray(PUSH)), 60).disturbance)
    k, pole = np.arange(1, 61)[:, None], np.sqrt(1 - gain)
    np.testing.assert_allclose(estimate, PUSH * (1 - (1 - (1 - pole) * k) * pole**k), atol=1e-8)


def test_lead_changes_the_reported_disturbance_but_not_the_memory():
    pushes = [
        np.asarray(followed(Measured.critical(0.3, a), accelerated(jnp.asarray(PUSH)), 40).disturbance)
        for a in (0, 1, 3)
    ]
    np.testing.assert_allclose(pushes[2] - pushes[0], 3 * (pushes[1] - pushes[0]), atol=1e-9)
    assert np.abs(pushes[1] - pushes[0]).max() > 0.01


def test_trend_gains_are_refused_exactly_where_they_are_unstable():
    for gain in np.linspace(0.0, 1.0, 11):
        for share in np.linspace(0.02, 0.98, 13):
            for trend, stable in ((share * (4 - 2 * gain), True), ((1 + share) * (4 - 2 * gain), False)):
                decay = np.array([[1 - gain, 1 - gain], [-trend, 1 - trend]])
                # Without a gain the error of the disturbance itself never decays; it must not grow either.
                assert (np.max(np.abs(np.linalg.eigvals(decay))) <= 1 + 1e-12) == stable
                if stable:
                    Measured(gain, trend)
                else:
                    with pytest.raises(DefinitionError, match="trend"):
                        Measured(gain, trend)


@pytest.mark.parametrize(("cutoff", "gain"), [(50.0, 0.25), (300.0, 0.5), (5000.0, 1.0)])
def test_filtered_difference_errors_follow_the_derived_recursion(cutoff, gain):
    estimate = followed(FilteredDifference(cutoff, gain), accelerated(jnp.asarray(PUSH)), 60)
    error = np.stack([np.zeros(2), PUSH * 1e-3])
    for k in range(60):
        error = errors_decay(cutoff, gain, 1e-3) @ error
        right = np.array([1.0, -2.0]) + PUSH * (k + 1) * 1e-3
        np.testing.assert_allclose(estimate.state.dq[k], right - error[0], atol=1e-9)
        np.testing.assert_allclose(estimate.disturbance[k], PUSH - error[1] / 1e-3, atol=1e-7)


def recursion_of(cutoffs, gains, period):
    """Recursion matrix of the filter's own errors for each joint, as in `errors_decay`, [n 2 2]."""
    estimator, elapsed = FilteredDifference(cutoffs, gains), jnp.asarray(period)
    rest, columns = jnp.zeros(len(cutoffs)), []
    for of_velocity, of_disturbance in ((1.0, 0.0), (0.0, 1.0)):
        last = Estimate(State(q=rest, dq=rest + of_velocity), rest + of_disturbance / period)
        prior = predicted(last, elapsed)
        estimate, _ = estimator(State(q=rest, dq=rest), prior, elapsed, jnp.asarray(False), last.state)
        columns.append([estimate.state.dq, estimate.disturbance * period])
    return np.transpose(columns)


def test_filtered_difference_errors_decay_for_every_cutoff_period_and_gain():
    shares, gains = (grid.ravel() for grid in np.meshgrid(np.linspace(0.001, 0.999, 40), np.linspace(0.01, 1.0, 20)))
    decay = recursion_of(-np.log(1 - shares), gains, 1.0)
    assert np.max(np.abs(np.linalg.eigvals(decay))) < 1.0


def test_filtered_difference_is_critically_damped_at_a_gain_of_a_quarter():
    """The two rates are equal, and about half the cutoff."""
    critical, damped = np.log(np.linalg.eigvals(recursion_of([10.0, 10.0], [0.25, 0.5], 1e-4)).astype(complex)) / 1e-4
    np.testing.assert_allclose(critical, -5.0, atol=0.2)
    np.testing.assert_allclose(-damped.real / np.abs(damped), 1 / (2 * np.sqrt(0.5)), rtol=1e-3)


def test_filtered_difference_with_a_lower_cutoff_passes_less_noise():
    noise = jnp.asarray(np.random.default_rng(0).normal(size=(4000, 2)) * 1e-5)

    def spread(cutoff):
        estimate = followed(FilteredDifference(cutoff), accelerated(jnp.zeros(2)), 4000, noise=noise)
        return np.std(np.asarray(estimate.state.dq)[1000:, 0])

    assert spread(50.0) < 0.4 * spread(300.0) < 0.4 * spread(2000.0)


def test_filtered_difference_has_no_lag_under_a_known_disturbance():
    """With the disturbance known from the start, a strong acceleration leaves no error, however low the cutoff."""
    estimate = followed(FilteredDifference(1.0, 0.0), accelerated(jnp.array([7.0, 7.0])), 500, disturbance=7.0)
    right = np.array([1.0, -2.0]) + 7.0 * np.arange(1, 501)[:, None] * 1e-3
    np.testing.assert_allclose(estimate.state.dq, right, atol=1e-11)


@pytest.mark.parametrize(
    ("make", "field", "value", "rule"),
    [
        (Measured, "gain", [0.5, -0.1], r"must be in \[0, 1\]; got -0.1 for joint 2"),
        (
            Measured,
            "trend",
            [0.1, -0.1],
            r"must be in \[0, `4 - 2 \* gain` = 3.4\].*stable \(Jury\); got -0.1 for joint 2",
        ),
        (Measured, "ahead", -1.0, "must be >= 0 periods; got -1"),
        (Measured, "ahead", [1.0, 2.0], "must be one number; got shape"),
        (FilteredDifference, "cutoff", 0.0, "must be > 0 rad/s; got 0"),
        (FilteredDifference, "gain", float("nan"), r"must be in \[0, 1\]; got nan"),
    ],
)
def test_estimator_parameter_outside_its_range_is_refused(make, field, value, rule):
    with pytest.raises(DefinitionError, match=rf"`{make.__name__}\.{field}` {rule}"):
        make(**({"cutoff": 1.0} if make is FilteredDifference else {}) | {field: value})


L0, L1, L2 = GAINS


def step(lipschitz, residual, period=1e-3):
    """The correction of position, velocity and disturbance by one measurement."""
    none = jnp.zeros(1)
    prior = Estimate(state=State(q=none, dq=none), disturbance=none)
    measured = State(q=jnp.array([residual]), dq=none)
    estimate, _ = RobustDifferentiator(lipschitz)(measured, prior, jnp.asarray(period), jnp.asarray(False), ())
    return float(estimate.state.q[0]), float(estimate.state.dq[0]), float(estimate.disturbance[0])


def test_differentiator_root_solves_its_cubic_to_rounding():
    rest = np.logspace(-300, 290, 3001)
    y = np.asarray(_root(jnp.asarray(rest)))
    np.testing.assert_allclose(y**3 + L0 * y**2 + L1 * y, rest, rtol=1e-14)
    np.testing.assert_array_equal(_root(jnp.zeros(2)), 0.0)


@pytest.mark.parametrize("residual", [1e-9, -3e-9, 1e-8, 1e-6, -1e-4, 1e-2, 3.0, -1e5])
@pytest.mark.parametrize("lipschitz", [1.0, 30.0])
@pytest.mark.parametrize("h", [1e-3, 1e-2])
def test_differentiator_step_is_implicit_euler_on_levants_differentiator(residual, lipschitz, h):
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


def test_a_small_residual_corrects_the_position_completely():
    h, lipschitz = 1e-3, 7.0
    edge = L2 * lipschitz * h**3
    for share in (-1.0, -0.5, 0.25, 0.99):
        q, dq, disturbance = step(lipschitz, share * edge, h)
        np.testing.assert_allclose([q, dq, disturbance], share * edge * np.array([1, 1.5 / h, 1 / h**2]), rtol=1e-12)
    assert 0 < step(lipschitz, 1.01 * edge, h)[0] < 1.01 * edge


@pytest.mark.full
def test_the_correction_grows_with_the_residual_and_is_odd():
    residuals = np.logspace(-12, 3, 400)
    steps = np.array([step(5.0, residual) for residual in residuals])
    assert np.all(np.diff(steps[:, :2], axis=0) > 0) and np.all(np.diff(steps[:, 2]) >= 0)
    np.testing.assert_array_equal(step(5.0, -1e-6), -np.array(step(5.0, 1e-6)))


def test_the_disturbance_estimate_changes_no_faster_than_its_bound():
    np.testing.assert_allclose(step(5.0, 1e3)[2], L2 * 5.0 * 1e-3, rtol=1e-12)


def test_small_errors_vanish_after_three_samples():
    """Errors of position, velocity and disturbance are deadbeat while the bound allows the correction."""
    true = accelerated(jnp.array([4.0, -0.5]))
    estimator, period = RobustDifferentiator(1e5), jnp.asarray(1e-3)
    start = true(jnp.zeros(()))
    last = Estimate(state=State(q=start.q + 1e-6, dq=start.dq - 1e-3), disturbance=jnp.zeros(2))
    for k in range(1, 4):
        estimate, _ = estimator(true(k * period), predicted(last, period), period, jnp.asarray(False), ())
        last = estimate
    np.testing.assert_allclose(last.disturbance, [4.0, -0.5], atol=1e-7)
    np.testing.assert_allclose(last.state.dq, true(3 * period).dq, atol=1e-10)


@pytest.mark.parametrize("period", [1e-3, 1e-2, 1e-1])
def test_a_constant_disturbance_is_estimated_in_finite_time_without_chattering(period):
    """Convergence takes about 1.7 times the disturbance over L; only position rounding over h² remains."""
    samples = round(8.0 / period)
    estimate = np.asarray(
        followed(RobustDifferentiator(4.0), accelerated(jnp.array([4.0, -0.5])), samples, period).disturbance
    )
    late = np.arange(1, samples + 1) * period > 2.0
    np.testing.assert_allclose(estimate[late], np.tile([4.0, -0.5], (np.sum(late), 1)), atol=1e-13 / period**2 + 1e-10)


@pytest.mark.parametrize("lipschitz", [1.0, 3.0, 100.0])
def test_a_disturbance_of_bounded_rate_is_estimated_up_to_the_sampling_error(lipschitz):
    """For any bound the disturbance lags by a period and the velocity errs by a third of `h²` times its rate."""
    errors = []
    for period in (0.02, 0.01):
        samples = round(8.0 / period)
        estimate = followed(RobustDifferentiator(lipschitz), swinging, samples, period)
        times = np.arange(1, samples + 1)[:, None] * period
        q = np.concatenate([np.sin(times), np.cos(times)], axis=1)
        dq = np.concatenate([np.cos(times), -np.sin(times)], axis=1)
        late = times[:, 0] > 4.0
        np.testing.assert_array_less(np.abs(estimate.state.q - q)[late], 1e-14)
        errors.append([np.max(np.abs(a - b)[late]) for a, b in ((estimate.state.dq, dq), (estimate.disturbance, -q))])
        np.testing.assert_allclose(errors[-1], [period**2 / 3, period], rtol=0.01)
    np.testing.assert_allclose(np.log2(np.array(errors[0]) / errors[1]), [2.0, 1.0], atol=0.01)


def test_noise_error_is_bounded_and_smaller_for_a_lower_lipschitz_bound():
    """Levant's accuracy: errors of the velocity as the power 2/3 of the noise, of the disturbance as the power 1/3."""
    rng = np.random.default_rng(0)
    rough, errors = jnp.asarray(rng.uniform(-1.0, 1.0, (8000, 2))), []
    right = np.stack([np.cos(np.arange(1, 8001) * 1e-3), -np.sin(np.arange(1, 8001) * 1e-3)], axis=1)
    for size in (1e-6, 1e-3):
        estimate = followed(RobustDifferentiator(1.0), swinging, 8000, noise=size * rough)
        off = np.abs(np.asarray(estimate.state.dq) - right)[4000:]
        errors.append(np.max(off))
        assert np.max(off) < 5.0 * size ** (2 / 3)
    assert 30.0 < errors[1] / errors[0] < 300.0
    wild = followed(RobustDifferentiator(100.0), swinging, 8000, noise=1e-3 * rough)
    assert np.max(np.abs(np.asarray(wild.state.dq) - right)[4000:]) > 2.0 * errors[1]


@pytest.mark.parametrize("value", [0.0, [1.0, -1.0], float("inf")])
def test_a_lipschitz_bound_that_is_not_positive_and_finite_is_refused(value):
    with pytest.raises(DefinitionError, match=r"`RobustDifferentiator\.lipschitz` must be > 0"):
        RobustDifferentiator(value)
