"""Fastest rest-to-rest motions within limits: against closed forms and against Ruckig's samples."""

import builtins
import math
from itertools import pairwise

import numpy as np
import pytest
import ruckig
from hypothesis import given, settings
from hypothesis import strategies as st

from slidax.core.errors import DefinitionError
from slidax.motions import Trapezoidal

from .differentiated import derivative

PATH = np.array([[0.0, 1.0, 0.2], [0.8, 0.2, 0.2], [0.5, -0.4, 0.9], [-0.3, 0.6, 0.1]])
SPEED, ACCELERATION, JERK = np.array([1.5, 2.0, 1.0]), np.array([4.0, 3.0, 6.0]), np.array([30.0, 60.0, 60.0])


def trapezoid_time(distance, velocity, acceleration):
    if velocity**2 / acceleration < distance:
        return distance / velocity + velocity / acceleration
    return 2 * math.sqrt(distance / acceleration)


@settings(max_examples=30)
@given(st.floats(1e-3, 100.0), st.floats(0.1, 10.0), st.floats(0.1, 50.0))
def test_duration_of_a_single_joint_is_that_of_its_trapezoidal_or_triangular_profile(distance, velocity, acceleration):
    motion = Trapezoidal.through([[0.0], [-distance]], velocity=velocity, acceleration=acceleration)
    assert float(motion.until) == pytest.approx(trapezoid_time(distance, velocity, acceleration), rel=1e-9)
    assert motion.extremes(2).size[0] == pytest.approx(acceleration, rel=1e-9)


def test_jerk_limit_gives_the_s_curve_that_reaches_all_three_limits():
    motion = Trapezoidal.through([[0.0], [3.0]], velocity=1.0, acceleration=2.0, jerk=20.0)
    assert float(motion.until) == pytest.approx(3.0 / 1.0 + 1.0 / 2.0 + 2.0 / 20.0, rel=1e-9)
    np.testing.assert_allclose([motion.extremes(order).size[0] for order in (1, 2, 3)], [1.0, 2.0, 20.0], rtol=1e-9)


@pytest.mark.parametrize("jerk", [math.inf, JERK])
def test_no_limit_is_exceeded_and_every_segment_reaches_a_limit(jerk):
    motion = Trapezoidal.through(PATH, velocity=SPEED, acceleration=ACCELERATION, jerk=jerk)
    t = np.linspace(0.0, float(motion.until), 20_001)[:-1]
    for order, limit in ((1, SPEED), (2, ACCELERATION), (3, np.broadcast_to(jerk, 3))):
        assert np.all(np.abs(derivative(motion, order, t)).max(axis=0) <= limit * (1 + 1e-9))
        assert np.all(motion.extremes(order).size <= limit * (1 + 1e-9))
    for here, there in pairwise(PATH):
        segment = Trapezoidal.through([here, there], velocity=SPEED, acceleration=ACCELERATION, jerk=jerk)
        reached = [np.max(segment.extremes(1).size / SPEED), np.max(segment.extremes(2).size / ACCELERATION)]
        assert max(reached) == pytest.approx(1.0, abs=1e-9)


def test_all_joints_arrive_together_with_the_slowest():
    goal = np.array([1.0, 2.0, 0.1])
    motion = Trapezoidal.through([np.zeros(3), goal], velocity=SPEED, acceleration=ACCELERATION)
    alone = [trapezoid_time(*numbers) for numbers in zip(goal, SPEED, ACCELERATION, strict=True)]
    assert float(motion.until) == pytest.approx(max(alone), rel=1e-9)
    shortly_before = derivative(motion, 1, [float(motion.until) - 1e-3])[0]
    assert np.all(shortly_before > 0)


def test_equal_limits_give_a_straight_line():
    motion = Trapezoidal.through([[0.0, 0.0], [1.0, -0.5]], velocity=1.0, acceleration=2.0)
    place = derivative(motion, 0, np.linspace(0.0, float(motion.until), 101))
    np.testing.assert_allclose(place[:, 1], -0.5 * place[:, 0], atol=1e-12)


@pytest.mark.parametrize("jerk", [math.inf, JERK])
def test_trapezoidal_motion_agrees_with_ruckig(jerk):
    motion = Trapezoidal.through(PATH, velocity=SPEED, acceleration=ACCELERATION, jerk=jerk, start=0.4)
    begin = 0.4
    for here, there in pairwise(PATH):
        question = ruckig.InputParameter(3)
        question.current_position, question.target_position = list(here), list(there)
        question.max_velocity, question.max_acceleration = list(SPEED), list(ACCELERATION)
        question.max_jerk = list(np.broadcast_to(jerk, 3))
        question.synchronization = ruckig.Synchronization.Phase
        answer = ruckig.Trajectory(3)
        ruckig.Ruckig(3).calculate(question, answer)
        times = np.linspace(0.0, answer.duration, 203)[1:-1]
        place, velocity, acceleration = np.swapaxes([answer.at_time(t) for t in times], 0, 1)
        np.testing.assert_allclose(derivative(motion, 0, begin + times), place, atol=1e-9)
        np.testing.assert_allclose(derivative(motion, 1, begin + times), velocity, atol=1e-9)
        np.testing.assert_allclose(derivative(motion, 2, begin + times), acceleration, atol=1e-7)
        begin += answer.duration
    assert float(motion.until) == pytest.approx(begin, rel=1e-12)


@settings(max_examples=30)
@given(st.integers(0, 10**6), st.booleans())
def test_segments_of_random_seven_joint_motions_join_without_a_jump(seed, smooth):
    generator = np.random.default_rng(seed)
    path = generator.normal(size=(4, 7)) * 10 ** generator.uniform(-3, 1, 7)
    velocity, acceleration = 10 ** generator.uniform(-1, 1, 7), 10 ** generator.uniform(-1, 1.5, 7)
    jerk = 10 ** generator.uniform(0, 3, 7) if smooth else math.inf
    motion = Trapezoidal.through(path, velocity=velocity, acceleration=acceleration, jerk=jerk)
    c, h = np.asarray(motion.coefficients), np.diff(motion.times)[:, None]
    place = ((c[0] * h + c[1]) * h + c[2]) * h + c[3]
    speed = (3 * c[0] * h + 2 * c[1]) * h + c[2]
    np.testing.assert_allclose(place[:-1], c[3, 1:], atol=1e-9 * np.abs(path).max())
    np.testing.assert_allclose(speed[:-1], c[2, 1:], atol=1e-8 * velocity.max())
    np.testing.assert_allclose(place[-1], path[-1], atol=1e-9 * np.abs(path).max())
    np.testing.assert_allclose(speed[-1], 0.0, atol=1e-8 * velocity.max())
    if smooth:
        curve = 6 * c[0] * h + 2 * c[1]
        np.testing.assert_allclose(curve[:-1], 2 * c[1, 1:], atol=1e-7 * acceleration.max())


def test_unlimited_velocity_gives_the_duration_of_a_triangular_profile():
    motion = Trapezoidal.through([[0.0], [4.0]], velocity=np.inf, acceleration=1.0)
    assert float(motion.until) == pytest.approx(4.0, rel=1e-12)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"acceleration": np.inf}, "`Trapezoidal.acceleration` must be finite, or the velocity would jump"),
        ({"velocity": 0.0}, "`Trapezoidal.velocity` must be > 0"),
        ({"jerk": [1.0, -2.0, 1.0]}, "`Trapezoidal.jerk` must be > 0; got -2 for joint 2"),
        ({"waypoints": [[0.0], [0.0]]}, "`Trapezoidal.waypoints` 1 and 2 are the same"),
    ],
)
def test_invalid_waypoints_and_limits_are_errors(changes, words):
    arguments = {"waypoints": PATH, "velocity": 1.0, "acceleration": 1.0} | changes
    with pytest.raises(DefinitionError, match=words):
        Trapezoidal.through(arguments.pop("waypoints"), **arguments)


def test_missing_ruckig_error_names_the_remedy(monkeypatch):
    real = builtins.__import__

    def without(name, *more, **keywords):
        if name == "ruckig":
            raise ImportError(name)
        return real(name, *more, **keywords)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(DefinitionError, match=r"pip install 'slidax\[trajectories\]'"):
        Trapezoidal.through(PATH, velocity=1.0, acceleration=1.0)
