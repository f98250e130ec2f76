"""The two simple estimators against their formulas and what they promise."""

import jax.numpy as jnp
import numpy as np
import pytest

from slidax.core.errors import DefinitionError
from slidax.core.types import State
from slidax.law import Estimate, FilteredDifference, Measured
from tests.law.estimators.followed import accelerated, followed

PUSH = np.array([4.0, -0.5])


def errors_decay(cutoff, gain, period):
    """The matrix by which the errors of velocity and disturbance, times h, go on, by hand."""
    a = 1 - np.exp(-cutoff * period)
    return np.array([[1 - a, 1 - a / 2], [-gain * a**2, 1 - gain * a**2 / 2]])


def test_the_measured_velocity_drives_the_push_by_what_was_not_predicted():
    none = jnp.zeros(2)
    prior = Estimate(state=State(q=none, dq=jnp.array([1.0, 2.0])), disturbance=jnp.array([0.5, -0.5]))
    measured = State(q=jnp.array([0.1, 0.2]), dq=jnp.array([1.01, 1.98]))
    estimator = Measured([0.5, 0.25])
    found, _ = estimator(measured, prior, jnp.asarray(0.01), jnp.asarray(False), estimator.init(measured))
    np.testing.assert_array_equal(found.state.q, measured.q)
    np.testing.assert_array_equal(found.state.dq, measured.dq)
    np.testing.assert_allclose(found.disturbance, [1.0, -1.0], rtol=1e-10)


@pytest.mark.parametrize("gain", [0.1, 0.5, 1.0])
def test_a_push_is_approached_by_a_share_of_what_is_left(gain):
    found = np.asarray(followed(Measured(gain), accelerated(jnp.asarray(PUSH)), 30).disturbance)
    left = (1 - gain) ** np.arange(1, 31)
    np.testing.assert_allclose(found, PUSH * (1 - left[:, None]), atol=1e-9)


def growing(t):
    """A motion whose disturbance is `PUSH t`: it grows evenly."""
    return State(q=jnp.array([0.1, 0.2]) + PUSH * t**3 / 6, dq=PUSH * t**2 / 2)


@pytest.mark.parametrize("ahead", [0.0, 1.0, 2.0, 2.5])
@pytest.mark.parametrize("make", [lambda ahead: Measured.critical(0.3, ahead), lambda ahead: Measured(0.5, 0.2, ahead)])
def test_a_push_that_grows_evenly_is_made_up_for_without_a_lag(make, ahead):
    """The disturbance is the one that there will be so many periods after the middle of the last one."""
    found = np.asarray(followed(make(ahead), growing, 400).disturbance)
    times = np.arange(1, 401)[:, None] * 1e-3
    np.testing.assert_allclose(found[200:], (PUSH * (times + (ahead - 0.5) * 1e-3))[200:], rtol=1e-9)


@pytest.mark.parametrize("gain", [0.2, 0.5])
def test_without_a_trend_the_push_lags_behind_one_that_grows(gain):
    found = np.asarray(followed(Measured(gain), growing, 400).disturbance)
    times = np.arange(1, 401)[:, None] * 1e-3
    lag = (0.5 + (1 - gain) / gain) * 1e-3
    np.testing.assert_allclose(found[200:], (PUSH * (times - lag))[200:], rtol=1e-9)


@pytest.mark.parametrize("gain", [0.05, 0.3, 0.9])
def test_the_critical_trend_makes_both_poles_equal(gain):
    """What is left of a constant disturbance goes as `(1 - (1 - p) k) pᵏ` with `p = √(1 - g)`: it passes zero once."""
    found = np.asarray(followed(Measured.critical(gain, 0.0), accelerated(jnp.asarray(PUSH)), 60).disturbance)
    k, pole = np.arange(1, 61)[:, None], np.sqrt(1 - gain)
    np.testing.assert_allclose(found, PUSH * (1 - (1 - (1 - pole) * k) * pole**k), atol=1e-8)


def test_how_far_ahead_changes_only_what_is_said_and_not_what_is_learnt():
    said = [
        np.asarray(followed(Measured.critical(0.3, a), accelerated(jnp.asarray(PUSH)), 40).disturbance)
        for a in (0, 1, 3)
    ]
    np.testing.assert_allclose(said[2] - said[0], 3 * (said[1] - said[0]), atol=1e-9)
    assert np.abs(said[1] - said[0]).max() > 0.01


def test_the_trend_may_be_as_large_as_the_filter_stays_stable():
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
def test_the_errors_of_the_filter_go_on_as_derived(cutoff, gain):
    estimate = followed(FilteredDifference(cutoff, gain), accelerated(jnp.asarray(PUSH)), 60)
    error = np.stack([np.zeros(2), PUSH * 1e-3])
    for k in range(60):
        error = errors_decay(cutoff, gain, 1e-3) @ error
        right = np.array([1.0, -2.0]) + PUSH * (k + 1) * 1e-3
        np.testing.assert_allclose(estimate.state.dq[k], right - error[0], atol=1e-9)
        np.testing.assert_allclose(estimate.disturbance[k], PUSH - error[1] / 1e-3, atol=1e-7)


def test_the_errors_of_the_filter_decay_for_every_cutoff_period_and_gain():
    for share in np.linspace(0.001, 0.999, 40):
        for gain in np.linspace(0.01, 1.0, 20):
            decay = errors_decay(-np.log(1 - share), gain, 1.0)
            assert np.max(np.abs(np.linalg.eigvals(decay))) < 1.0


def test_a_gain_of_a_quarter_damps_critically():
    """The two rates are equal, and about half the cutoff."""
    rates = np.log(np.linalg.eigvals(errors_decay(10.0, 0.25, 1e-4)).astype(complex)) / 1e-4
    np.testing.assert_allclose(rates, -5.0, atol=0.2)
    damped = np.log(np.linalg.eigvals(errors_decay(10.0, 0.5, 1e-4)).astype(complex)) / 1e-4
    np.testing.assert_allclose(-damped.real / np.abs(damped), 1 / (2 * np.sqrt(0.5)), rtol=1e-3)


def test_a_lower_cutoff_lets_less_noise_through():
    noise = jnp.asarray(np.random.default_rng(0).normal(size=(4000, 2)) * 1e-5)

    def spread(cutoff):
        found = followed(FilteredDifference(cutoff), accelerated(jnp.zeros(2)), 4000, noise=noise)
        return np.std(np.asarray(found.state.dq)[1000:, 0])

    assert spread(50.0) < 0.4 * spread(300.0) < 0.4 * spread(2000.0)


def test_the_filter_does_not_lag_behind_what_its_model_knows():
    """With the disturbance known from the start, a strong acceleration leaves no error, however low the cutoff."""
    found = followed(FilteredDifference(1.0, 0.0), accelerated(jnp.array([7.0, 7.0])), 500, disturbance=7.0)
    right = np.array([1.0, -2.0]) + 7.0 * np.arange(1, 501)[:, None] * 1e-3
    np.testing.assert_allclose(found.state.dq, right, atol=1e-11)


@pytest.mark.parametrize(
    ("make", "field", "value", "rule"),
    [
        (Measured, "gain", 1.5, r"must be in \[0, 1\]; got 1.5"),
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
def test_what_cannot_be_is_refused(make, field, value, rule):
    with pytest.raises(DefinitionError, match=rf"`{make.__name__}\.{field}` {rule}"):
        make(**({"cutoff": 1.0} if make is FilteredDifference else {}) | {field: value})
