"""Minimum-jerk motion through waypoints: its optimality and its continuity."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slidax.core.errors import DefinitionError
from slidax.motions import MinimumJerk

from .differentiated import derivative
from .members import PLACES, TIMES

MOTION = MinimumJerk.through(TIMES, PLACES)


def test_the_motion_passes_through_its_waypoints():
    np.testing.assert_allclose(derivative(MOTION, 0, TIMES), PLACES, atol=1e-12)


@pytest.mark.parametrize("order", [0, 1, 2, 3, 4])
def test_four_derivatives_are_continuous_at_the_inner_knots(order):
    h = 1e-10
    before, after = derivative(MOTION, order, TIMES[1:-1] - h), derivative(MOTION, order, TIMES[1:-1] + h)
    np.testing.assert_allclose(before, after, atol=1e-6)


def test_fifth_derivative_jumps_at_the_inner_knots():
    h = 1e-10
    before, after = derivative(MOTION, 5, TIMES[1:-1] - h), derivative(MOTION, 5, TIMES[1:-1] + h)
    assert np.abs(before - after).min() > 1.0


@pytest.mark.parametrize("order", [1, 2])
def test_the_motion_is_at_rest_at_both_ends(order):
    ends = np.array([TIMES[0] + 1e-12, TIMES[-1] - 1e-12])
    np.testing.assert_allclose(derivative(MOTION, order, ends), 0.0, atol=1e-8)


@settings(max_examples=25)
@given(st.floats(-5, 5), st.floats(0.1, 50.0), st.floats(-3, 3), st.floats(-3, 3))
def test_motion_between_two_waypoints_is_the_quintic_of_flash_and_hogan(start, duration, q0, q1):
    motion = MinimumJerk.through([start, start + duration], [[q0], [q1]])
    t = np.linspace(start, start + duration, 41)
    z = (t - start) / duration
    expected = q0 + (q1 - q0) * (10 * z**3 - 15 * z**4 + 6 * z**5)
    np.testing.assert_allclose(derivative(motion, 0, t)[:, 0], expected, atol=1e-11)


def test_no_other_motion_through_the_waypoints_has_less_jerk():
    """A perturbation that vanishes at all knots, with two derivatives at the ends, can only add to `∫ ‖jerk‖² dt`."""
    t = np.linspace(TIMES[0], TIMES[-1], 20_001)
    jerk = derivative(MOTION, 3, np.clip(t, TIMES[0] + 1e-12, TIMES[-1] - 1e-12))
    least = np.trapezoid(np.sum(jerk**2, axis=1), t)
    ends = np.polynomial.Polynomial.fromroots([TIMES[0], TIMES[-1]]) ** 3
    knots = np.polynomial.Polynomial.fromroots(TIMES[1:-1])
    for seed in range(5):
        wobble = np.polynomial.Polynomial(np.random.default_rng(seed).normal(size=3))
        shape = ends * knots * wobble
        change = np.stack([shape.deriv(3)(t), -0.5 * shape.deriv(3)(t)], axis=1)
        scale = 1e-2 / np.abs(shape(t)).max()
        for sign in (-1.0, 1.0):
            other = np.trapezoid(np.sum((jerk + sign * scale * change) ** 2, axis=1), t)
            assert other > least * (1 + 1e-5)
        first_order = np.trapezoid(np.sum(jerk * change, axis=1), t)
        size = np.sqrt(least * np.trapezoid(np.sum(change**2, axis=1), t))
        assert abs(first_order) < 1e-4 * size


def test_long_motions_with_many_waypoints_stay_accurate():
    times = np.cumsum(np.random.default_rng(0).uniform(0.5, 20.0, 30))
    waypoints = np.random.default_rng(1).normal(size=(30, 3))
    motion = MinimumJerk.through(times, waypoints)
    np.testing.assert_allclose(derivative(motion, 0, times), waypoints, atol=1e-9)


def test_too_many_waypoints_for_a_search_of_times_are_refused():
    rows = [[float(k % 2)] for k in range(1001)]
    with pytest.raises(DefinitionError, match=r"at most 100 waypoints; got 1001; pass times to"):
        MinimumJerk.within(rows, velocity=1.0, acceleration=1.0)
