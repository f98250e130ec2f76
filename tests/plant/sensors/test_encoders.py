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


def test_encoder_rounds_to_the_nearest_count_unless_the_resolution_is_negligible():
    measured = sampled(Encoders([0.1, 0.25]), at(0.37, -1.3))
    np.testing.assert_allclose(measured.state.q[-1], [0.4, 0.25], rtol=1e-15)
    np.testing.assert_array_equal(measured.state.dq[-1], [-1.3, -1.3])
    for resolution, q in ((0.0, 0.123456789), (1e-10, 1e300)):
        np.testing.assert_array_equal(sampled(Encoders(resolution), at(q)).state.q, q)


def test_rounding_has_a_derivative_of_1_by_the_position_and_0_by_the_resolution():
    """On and between the counts, for a common resolution and for one per joint."""
    q, off = jnp.array([0.37, -0.25, 0.1, 1e300]), jnp.array([1.0, -2.0, 3.0, 4.0])
    for resolution in (jnp.asarray(0.1), jnp.array([0.1, 0.25, 0.0, 1e-3])):
        value, change = jax.jvp(round_to_resolution, (q, resolution), (off, jnp.ones_like(resolution)))
        np.testing.assert_array_equal(value, round_to_resolution(q, resolution))
        np.testing.assert_array_equal(change, off)
        np.testing.assert_array_equal(jax.jacrev(round_to_resolution)(q, resolution), np.eye(4))


def test_noise_is_white_with_its_deviation_per_joint():
    measured = sampled(Encoders(0.0, [1e-3, 2e-3], 0.5), at(1.0, 2.0), samples=20_000).state
    noise = np.concatenate([np.asarray(measured.q) - 1.0, np.asarray(measured.dq) - 2.0], axis=1)
    np.testing.assert_allclose(np.mean(noise, axis=0) / [1e-3, 2e-3, 0.5, 0.5], 0.0, atol=0.03)
    np.testing.assert_allclose(np.std(noise, axis=0), [1e-3, 2e-3, 0.5, 0.5], rtol=0.02)
    np.testing.assert_allclose(np.corrcoef(noise.T), np.eye(4), atol=0.03)
    np.testing.assert_allclose(np.corrcoef(noise[:-1].T, noise[1:].T)[:4, 4:], 0.0, atol=0.03)


def test_noise_is_added_before_rounding():
    measured = np.asarray(sampled(Encoders(0.1, 0.3), at(0.0), samples=200).state.q)
    np.testing.assert_allclose(measured / 0.1, np.round(measured / 0.1), atol=1e-12)
    assert np.ptp(measured) > 0.5


@pytest.mark.full
def test_sensors_of_different_kinds_with_the_same_seed_are_uncorrelated():
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
    measured = sampled(DifferencedEncoders(1e-3, 0.0, cutoff), period=period).state
    np.testing.assert_allclose(measured.q, q, rtol=1e-13)
    np.testing.assert_allclose(measured.dq, expected, rtol=1e-11)


def test_a_drive_lags_behind_an_acceleration_by_its_filter():
    """The final lag is `a (h/2 + h (1 - share)/share)`, which is about `a/c`."""
    period, cutoff = 1e-3, 100.0
    measured = sampled(
        DifferencedEncoders(0.0, 0.0, cutoff),
        lambda t: State(q=t[None] ** 2 / 2, dq=t[None]),
        samples=2000,
        period=period,
    )
    share = 1 - np.exp(-cutoff * period)
    lag = period / 2 + period * (1 - share) / share
    assert abs(lag - 1 / cutoff) < 1e-4
    np.testing.assert_allclose(measured.state.dq[-1], 1999 * period - lag, rtol=1e-9)


@pytest.mark.parametrize("make", [Encoders, DifferencedEncoders])
@pytest.mark.parametrize(
    ("field", "value", "rule"),
    [
        ("resolution", float("nan"), r"`{}\.{}` must be >= 0"),
        ("seed", 0.5, r"^a whole number or a list of whole numbers is needed; got 0\.5"),
        ("seed", [1, 2], "must be one number"),
    ],
)
def test_invalid_encoder_parameters_are_refused(make, field, value, rule):
    with pytest.raises(DefinitionError, match=rule.format(make.__name__, field)):
        make(**({"resolution": 0.0} | {field: value}))
