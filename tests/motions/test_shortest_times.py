"""Fastest motions through waypoints without a stop: limits hold everywhere, and shorter motions exceed them."""

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slidax.core.errors import DefinitionError
from slidax.motions import MinimumJerk

from .differentiated import derivative

PATH = np.array([[0.0, 1.0, 0.2], [0.8, 0.2, 0.2], [0.5, -0.4, 0.9], [-0.3, 0.6, 0.1], [0.1, 0.0, 0.0]])
SPEED, ACCELERATION, JERK = np.array([1.5, 2.0, 1.0]), np.array([4.0, 3.0, 6.0]), np.array([30.0, 60.0, 60.0])


def dense(motion, order):
    """The largest absolute value of each joint over all of the motion, by evaluation."""
    t = np.linspace(float(motion.times[0]), float(motion.times[-1]), 20_001)[:-1]
    return np.abs(derivative(motion, order, t)).max(axis=0)


@pytest.mark.parametrize("jerk", [None, JERK])
def test_no_limit_is_exceeded_and_at_least_one_limit_is_reached(jerk):
    motion = MinimumJerk.within(PATH, velocity=SPEED, acceleration=ACCELERATION, jerk=jerk)
    limits = {1: SPEED, 2: ACCELERATION} | ({} if jerk is None else {3: jerk})
    for order, limit in limits.items():
        assert np.all(dense(motion, order) <= limit * (1 + 1e-9))
        assert np.all(motion.extremes(order).size <= limit * (1 + 1e-9))
    reached = max(np.max(motion.extremes(order).size / limit) for order, limit in limits.items())
    assert reached == pytest.approx(1.0, abs=1e-9)


def test_the_waypoints_are_passed_in_order_without_a_stop():
    motion = MinimumJerk.within(PATH, velocity=SPEED, acceleration=ACCELERATION, start=0.7)
    assert float(motion.times[0]) == 0.7
    np.testing.assert_allclose(derivative(motion, 0, motion.times), PATH, atol=1e-12)
    assert np.all(np.abs(derivative(motion, 1, motion.times[1:-1])).max(axis=1) > 0.1)


@settings(max_examples=25)
@given(st.floats(1e-3, 100.0), st.floats(0.1, 10.0), st.floats(0.1, 50.0), st.floats(1.0, 1000.0))
def test_the_time_between_two_waypoints_is_that_of_the_closed_form(distance, velocity, acceleration, jerk):
    """The quintic's velocity peaks at 15/8, its acceleration at 10/√3, its jerk at 60, in units of its own."""
    motion = MinimumJerk.within([[0.0], [distance]], velocity=velocity, acceleration=acceleration, jerk=jerk)
    expected = max(
        15 / 8 * distance / velocity,
        math.sqrt(10 / math.sqrt(3) * distance / acceleration),
        (60 * distance / jerk) ** (1 / 3),
    )
    assert float(motion.until) == pytest.approx(expected, rel=1e-9)


def test_slowest_joint_sets_the_time_of_all():
    both = MinimumJerk.within([[0.0, 0.0], [1.0, 2.0]], velocity=[1.0, 1.0], acceleration=np.inf)
    assert float(both.until) == pytest.approx(15 / 8 * 2.0)
    np.testing.assert_allclose(both.extremes(1).size, [0.5, 1.0])


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_no_other_division_of_the_time_is_shorter_for_three_waypoints(seed):
    """Three waypoints have one free parameter, the share of the first piece: the test tries all its values."""
    generator = np.random.default_rng(seed)
    path = generator.normal(size=(3, 2))
    limits = {"velocity": 2.0, "acceleration": 8.0, "jerk": 150.0}
    duration = float(MinimumJerk.within(path, **limits).until)

    def shortest(share):
        """Stretched by hand: a derivative of order i scales with the i-th power of the duration."""
        motion = MinimumJerk.through([0.0, share, 1.0], path)
        peaks = zip((1, 2, 3), limits.values(), strict=True)
        return max((motion.extremes(order).size.max() / limit) ** (1 / order) for order, limit in peaks)

    least = min(shortest(share) for share in np.linspace(0.05, 0.95, 451))
    assert least * (1 - 1e-3) <= duration <= least * (1 + 2e-4)


def test_seven_joints_through_twelve_waypoints_are_faster_than_with_a_stop_at_each():
    path = np.random.default_rng(4).normal(size=(12, 7))
    limits = {"velocity": 2.0, "acceleration": 10.0, "jerk": 200.0}
    whole = MinimumJerk.within(path, **limits)
    pieces = sum(float(MinimumJerk.within(np.stack([a, b]), **limits).until) for a, b in pairwise(path))
    assert float(whole.until) < 0.9 * pieces


def test_a_limited_joint_keeps_its_limits_among_joints_without_limits():
    motion = MinimumJerk.within(PATH, velocity=[1.0, np.inf, np.inf], acceleration=[5.0, np.inf, np.inf])
    assert motion.extremes(1).size[0] <= 1.0 + 1e-9
    assert motion.extremes(2).size[0] <= 5.0 + 1e-9


@pytest.mark.parametrize(
    ("waypoints", "limits", "words"),
    [
        ([[0.0, 0.0]], {}, r"`MinimumJerk.waypoints` must be two or more rows.*got shape \[1, 2\]"),
        ([[0.0, 0.0], [1.0]], {}, "rows of numbers, all with one position per joint"),
        ([[0.0, 0.0], [1.0, np.nan]], {}, "waypoint 2 is not, for joint 2"),
        (
            [[0.0, 0.0], [1.0, 1.0], [1.0, 1.0]],
            {},
            "`MinimumJerk.waypoints` 2 and 3 are the same.*leave one of them out",
        ),
        (PATH, {"velocity": [1.0, 0.0, 1.0]}, "`MinimumJerk.velocity` must be > 0; got 0 for joint 2"),
        (PATH, {"acceleration": -1.0}, "`MinimumJerk.acceleration` must be > 0; got -1 for joint 1"),
        (PATH, {"jerk": np.nan}, "`MinimumJerk.jerk` must be numbers"),
        (PATH, {"velocity": [1.0, 1.0]}, "one number or one for each of the 3 joints"),
        (PATH, {"velocity": "fast"}, "a number or a list of numbers; got 'fast'"),
        (
            PATH,
            {"velocity": np.inf, "acceleration": np.inf},
            "finite limit for a joint that moves from waypoint 1 to 2",
        ),
    ],
)
def test_invalid_waypoints_and_limits_are_errors(waypoints, limits, words):
    with pytest.raises(DefinitionError, match=words):
        MinimumJerk.within(waypoints, **({"velocity": 1.0, "acceleration": 1.0} | limits))
