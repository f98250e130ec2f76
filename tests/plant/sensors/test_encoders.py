"""Rounding, noise and velocities of encoders against their definitions."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from slidax.core.errors import DefinitionError
from slidax.core.types import State
from slidax.plant import Delayed, DifferencedEncoders, Encoders, Lossy
from slidax.plant.sensors import round_to_resolution
from tests.plant.sensors.sampled import moving, sampled


def at(q, dq=0.0):
    return lambda t: State(q=jnp.full(2, q), dq=jnp.full(2, dq))


def test_an_exact_encoder_is_rounded_to_its_nearest_count():
    seen = sampled(Encoders([0.1, 0.25]), at(0.37, -1.3))
    np.testing.assert_allclose(seen.state.q[-1], [0.4, 0.25], rtol=1e-15)
    np.testing.assert_array_equal(seen.state.dq[-1], [-1.3, -1.3])


def test_a_resolution_of_zero_rounds_nothing():
    np.testing.assert_array_equal(sampled(Encoders(0.0), at(0.123456789)).state.q, 0.123456789)


def test_the_derivative_passes_straight_through_the_rounding():
    """By the position it is 1 on and between the counts, by the resolution 0; whatever the joints share of it."""
    q, off = jnp.array([0.37, -0.25, 0.1, 1e300]), jnp.array([1.0, -2.0, 3.0, 4.0])
    for resolution in (jnp.asarray(0.1), jnp.array([0.1, 0.25, 0.0, 1e-3])):
        value, change = jax.jvp(round_to_resolution, (q, resolution), (off, jnp.ones_like(resolution)))
        np.testing.assert_array_equal(value, round_to_resolution(q, resolution))
        np.testing.assert_array_equal(change, off)
        np.testing.assert_array_equal(jax.jacrev(round_to_resolution)(q, resolution), np.eye(4))


def test_beyond_the_last_count_the_number_itself_is_measured():
    np.testing.assert_array_equal(sampled(Encoders(1e-10), at(1e300)).state.q, 1e300)


def test_noise_is_white_with_its_deviation_per_joint():
    seen = sampled(Encoders(0.0, [1e-3, 2e-3], 0.5), at(1.0, 2.0), samples=20_000).state
    noise = np.concatenate([np.asarray(seen.q) - 1.0, np.asarray(seen.dq) - 2.0], axis=1)
    np.testing.assert_allclose(np.mean(noise, axis=0) / [1e-3, 2e-3, 0.5, 0.5], 0.0, atol=0.03)
    np.testing.assert_allclose(np.std(noise, axis=0), [1e-3, 2e-3, 0.5, 0.5], rtol=0.02)
    np.testing.assert_allclose(np.corrcoef(noise.T), np.eye(4), atol=0.03)
    np.testing.assert_allclose(np.corrcoef(noise[:-1].T, noise[1:].T)[:4, 4:], 0.0, atol=0.03)


def test_noise_comes_before_rounding():
    seen = np.asarray(sampled(Encoders(0.1, 0.3), at(0.0), samples=200).state.q)
    np.testing.assert_allclose(seen / 0.1, np.round(seen / 0.1), atol=1e-12)
    assert np.ptp(seen) > 0.5


@pytest.mark.full
def test_sensors_of_different_kinds_with_one_seed_are_not_correlated():
    def clock(t):
        return State(q=t[None], dq=jnp.ones(1))

    noise = np.asarray(sampled(Encoders(0.0, 1.0, seed=7), at(0.0), samples=4000).state.q)[:, 0]
    other = np.asarray(sampled(DifferencedEncoders(0.0, 1.0, seed=7), at(0.0), samples=4000).state.q)[:, 0]
    lost = ~np.asarray(sampled(Lossy(Encoders(0.0), 0.5, seed=7), samples=4000).fresh)
    late = np.asarray(sampled(Delayed(Encoders(0.0), 5.0, 9.0, seed=7), clock, 4000).state.q)[:, 0]
    late = late - np.arange(4000) * 1e-2
    assert np.std(late) > 0
    np.testing.assert_allclose(np.corrcoef([noise, other, lost, late]), np.eye(4), atol=0.06)


def test_the_velocity_of_a_drive_is_the_filtered_difference_of_its_counts():
    period, cutoff = 1e-2, np.array([40.0, 300.0])
    q = np.round(np.asarray(jax.vmap(lambda t: moving(t).q)(jnp.asarray(np.arange(12) * period))) / 1e-3) * 1e-3
    v, expected = np.array([3.0, -1.0]), [np.array([3.0, -1.0])]
    for k in range(1, 12):
        v = v + (1 - np.exp(-cutoff * period)) * ((q[k] - q[k - 1]) / period - v)
        expected.append(v)
    seen = sampled(DifferencedEncoders(1e-3, 0.0, cutoff), period=period).state
    np.testing.assert_allclose(seen.q, q, rtol=1e-13)
    np.testing.assert_allclose(seen.dq, expected, rtol=1e-11)


def test_a_drive_reports_a_constant_velocity_without_error():
    seen = sampled(DifferencedEncoders(0.0), lambda t: State(q=jnp.stack([2.0 * t, -t]), dq=jnp.array([2.0, -1.0])))
    np.testing.assert_allclose(seen.state.dq, np.tile([2.0, -1.0], (12, 1)), rtol=1e-12)


def test_a_drive_lags_behind_an_acceleration_by_its_filter():
    """After a long time by `a (h/2 + h (1 - share)/share)`, which is about `a/c`."""
    period, cutoff = 1e-3, 100.0
    seen = sampled(
        DifferencedEncoders(0.0, 0.0, cutoff),
        lambda t: State(q=t[None] ** 2 / 2, dq=t[None]),
        samples=2000,
        period=period,
    )
    share = 1 - np.exp(-cutoff * period)
    lag = period / 2 + period * (1 - share) / share
    assert abs(lag - 1 / cutoff) < 1e-4
    np.testing.assert_allclose(seen.state.dq[-1], 1999 * period - lag, rtol=1e-9)


@pytest.mark.parametrize("make", [Encoders, DifferencedEncoders])
@pytest.mark.parametrize(
    ("field", "value"), [("resolution", -1e-5), ("position_noise", [0.0, -1.0]), ("resolution", float("nan"))]
)
def test_what_cannot_be_is_refused(make, field, value):
    with pytest.raises(DefinitionError, match=rf"`{make.__name__}\.{field}` must be >= 0"):
        make(**({"resolution": 0.0} | {field: value}))


def test_a_filter_without_a_cutoff_is_refused():
    with pytest.raises(DefinitionError, match=r"cutoff` must be > 0 rad/s; got 0"):
        DifferencedEncoders(0.0, cutoff=0.0)


def test_a_seed_that_is_not_whole_is_refused():
    with pytest.raises(DefinitionError, match=r"a whole number or a list of whole numbers is needed; got 0\.5"):
        Encoders(0.0, seed=0.5)
    with pytest.raises(DefinitionError, match="must be one number"):
        Encoders(0.0, seed=[1, 2])
