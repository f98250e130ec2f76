"""Delays and losses against their definitions."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from slidax.core.errors import DefinitionError
from slidax.core.types import State
from slidax.plant import Delayed, DifferencedEncoders, Encoders, Exact, Lossy
from slidax.plant.timing import TRACES
from tests.plant.sensors.sampled import moving, sampled


def truth(times):
    return jax.vmap(moving)(jnp.asarray(times))


def clock(t):
    return State(q=t[None], dq=jnp.ones(1))


def one_outage(sensor, **numbers):
    return Lossy(sensor, starts=[1], **numbers)


def cubic(t):
    """A cubic polynomial, which the interpolation reproduces."""
    return State(q=jnp.stack([t * t * t - t, 2.0 - t * t]), dq=jnp.stack([3.0 * t * t - 1.0, -2.0 * t]))


@pytest.mark.parametrize("periods", [0, 1, 2, 7])
def test_a_whole_delay_returns_earlier_samples(periods):
    measured = sampled(Delayed(Exact(), periods), samples=30).state
    right = jax.tree.map(np.asarray, sampled(Exact(), samples=30).state)
    np.testing.assert_allclose(measured.q[periods:], right.q[: 30 - periods], atol=1e-15)
    np.testing.assert_allclose(measured.dq[periods:], right.dq[: 30 - periods], atol=1e-15)


@pytest.mark.parametrize("periods", [0.3, 1.5, 3.99])
def test_a_cubic_motion_is_delayed_without_error(periods):
    measured = sampled(Delayed(Exact(), periods), cubic, samples=200).state
    old = jax.vmap(cubic)(jnp.asarray((np.arange(200) - periods) * 1e-2))
    np.testing.assert_allclose(measured.q[4:], old.q[4:], atol=1e-14)
    np.testing.assert_allclose(measured.dq[4:], old.dq[4:], atol=1e-12)


def test_interpolation_error_is_of_order_four_in_position_and_three_in_velocity():
    errors = []
    for period in (0.04, 0.02):
        samples = round(4.0 / period)
        measured = sampled(Delayed(Exact(), 1.4), samples=samples, period=period).state
        right = truth((np.arange(samples) - 1.4) * period)
        errors.append([np.max(np.abs(a - b)[2:]) for a, b in ((measured.q, right.q), (measured.dq, right.dq))])
    orders = np.log2(np.array(errors[0]) / errors[1])
    np.testing.assert_allclose(orders, [4.0, 3.0], atol=0.1)


@pytest.mark.parametrize("periods", [1.0, 2.5, 6.0])
def test_a_delayed_sensor_assumes_constant_velocity_before_the_start(periods):
    measured = sampled(Delayed(Exact(), periods)).state
    start = moving(jnp.zeros(()))
    for k in range(int(np.ceil(periods))):
        np.testing.assert_allclose(measured.q[k], start.q - (periods - k) * 1e-2 * start.dq, rtol=1e-13)
        np.testing.assert_array_equal(measured.dq[k], start.dq)


def test_jittered_delays_fill_their_range_and_are_never_negative():
    def ages(periods, jitter):
        measured = np.asarray(sampled(Delayed(Exact(), periods, jitter), clock, 5000).state.q)[:, 0]
        return np.arange(5000) - measured / 1e-2

    spread = ages(2.0, 3.0)
    assert 0.5 - 1e-6 <= spread.min() < 0.52 and 3.48 < spread.max() <= 3.5 + 1e-6
    np.testing.assert_allclose([spread.mean(), spread.std()], [2.0, 3.0 / np.sqrt(12.0)], rtol=0.02)
    clipped = ages(0.2, 2.0)
    assert clipped.min() > -1e-6 and np.mean(np.abs(clipped) < 1e-6) == pytest.approx(0.4, abs=0.03)


def test_the_seed_determines_the_ages_of_jittered_samples():
    """A clock measured with the same seed shows the age."""
    times = np.asarray(sampled(Delayed(Exact(), 2.2, 3.0, seed=5), clock, 100).state.q)[:, 0]
    measured = sampled(Delayed(Exact(), 2.2, 3.0, seed=5), cubic, samples=100).state
    np.testing.assert_allclose(measured.q[4:], jax.vmap(cubic)(jnp.asarray(times)).q[4:], atol=1e-12)


def test_a_delayed_sensor_measures_the_earlier_state():
    delayed = sampled(Delayed(Encoders(1e-2), 2), samples=30).state
    right = sampled(Encoders(1e-2), samples=30).state
    np.testing.assert_array_equal(delayed.q[2:], right.q[:-2])


def test_a_delayed_drive_differences_the_earlier_counts():
    delayed = sampled(Delayed(DifferencedEncoders(1e-3), 1), samples=30).state
    right = sampled(DifferencedEncoders(1e-3), samples=30).state
    np.testing.assert_array_equal(delayed.q[1:], right.q[:-1])
    # Before the start the motion has a constant velocity; the first differences have the error of a count per period.
    np.testing.assert_allclose(delayed.dq[:2], np.tile(right.dq[0], (2, 1)), atol=1e-3 / 1e-2)
    np.testing.assert_allclose(delayed.dq[5:], right.dq[4:-1], atol=1e-8)


def test_planned_outages_have_their_length_and_repeat_the_last_sample():
    measured = sampled(Lossy(Exact(), starts=[0, 3, 8], counts=[2, 2, 1]))
    lost = [1, 3, 4, 8]
    np.testing.assert_array_equal(np.flatnonzero(~np.asarray(measured.fresh)), lost)
    right = sampled(Exact()).state
    for k in range(12):
        last = k - 1 if k in (1, 3, 8) else k - 2 if k == 4 else k
        np.testing.assert_array_equal(measured.state.q[k], right.q[last])
        np.testing.assert_array_equal(measured.state.dq[k], right.dq[last])


def test_a_pattern_of_losses_repeats_after_the_first_sample():
    measured = sampled(Lossy(Exact(), pattern=[1, 0, 1]))
    np.testing.assert_array_equal(np.flatnonzero(~np.asarray(measured.fresh)), [2, 3, 5, 6, 8, 9, 11])


@pytest.mark.parametrize(
    ("name", "lost", "length"),
    [("uneven", [1, 5, 7], 10), ("stalls", [1, 2, 3, 4, 5, 6], 1000), ("skips", [1], 2), ("overruns", [1], 500)],
)
def test_a_timing_trace_loses_the_samples_between_its_printed_updates(name, lost, length):
    pattern = TRACES[name].lost()
    assert len(pattern) == length
    np.testing.assert_array_equal(np.flatnonzero(pattern), lost)


def test_random_losses_are_independent():
    fresh = np.asarray(sampled(Lossy(Exact(), 0.2), samples=20_000).fresh)
    assert np.mean(~fresh) == pytest.approx(0.2, abs=0.01)
    assert abs(np.corrcoef(fresh[1:], fresh[:-1])[0, 1]) < 0.03


def test_with_loss_probability_one_only_the_first_sample_arrives():
    measured = sampled(Lossy(Exact(), 1.0))
    np.testing.assert_array_equal(measured.fresh, [True] + [False] * 11)
    np.testing.assert_array_equal(measured.state.q, np.tile(moving(jnp.zeros(())).q, (12, 1)))


def test_a_sample_is_lost_if_any_sensor_of_the_chain_loses_it():
    measured = sampled(Lossy(Lossy(Exact(), starts=[2], counts=[2]), starts=[3], counts=[2]))
    np.testing.assert_array_equal(np.flatnonzero(~np.asarray(measured.fresh)), [2, 3, 4])
    np.testing.assert_array_equal(measured.state.q[4], sampled(Exact()).state.q[1])


def test_a_drive_keeps_differencing_while_its_messages_are_lost():
    drive = DifferencedEncoders(1e-3, 0.0, 100.0)
    measured, right = sampled(Lossy(drive, starts=[4], counts=[3])), sampled(drive)
    np.testing.assert_array_equal(measured.state.dq[7:], right.state.dq[7:])


def test_outages_vary_in_a_batch():
    def fresh(start):
        sensor = Lossy(Exact(), starts=[1], counts=[2])
        return sampled(eqx.tree_at(lambda sensor: sensor.starts, sensor, start[None]), samples=6).fresh

    lost = ~np.asarray(jax.vmap(fresh)(jnp.array([1, 3])))
    np.testing.assert_array_equal(lost, [[0, 1, 1, 0, 0, 0], [0, 0, 0, 1, 1, 0]])


@pytest.mark.parametrize(
    ("make", "field", "value", "rule"),
    [
        (Delayed, "periods", -1.0, r"must be in \[0, 100\]; got -1"),
        (Delayed, "periods", float("inf"), r"must be in \[0, 100\]; got inf"),
        (Delayed, "jitter", -0.5, r"must be in \[0, 100\]; got -0.5"),
        (Lossy, "probability", [0.1, 0.2], "must be one number"),
        (Lossy, "starts", [1], "must have one entry for each of `starts`"),
        (Lossy, "starts", [0.5], "whole"),
        (one_outage, "counts", [-1], r"`Lossy\.counts` must be >= 0 samples; got -1 for entry 1"),
    ],
)
def test_invalid_delays_and_losses_are_refused(make, field, value, rule):
    with pytest.raises(DefinitionError, match=rule):
        make(Exact(), **({"periods": 1.0} if make is Delayed else {}) | {field: value})


@pytest.mark.parametrize(
    "build",
    [
        lambda: Encoders(0.0, seed=jnp.asarray(0.5)),
        lambda: Lossy(Exact(), pattern=jnp.asarray([0.5, 0.0])),
        lambda: Lossy(Exact(), pattern=[0.5, 0.0]),
    ],
)
def test_a_fraction_in_place_of_a_whole_number_is_refused(build):
    with pytest.raises(DefinitionError, match="a whole number or a list of whole numbers is needed"):
        build()
