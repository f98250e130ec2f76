"""Every trajectory: one line here enrols a new one in `tests/laws/test_trajectories.py`."""

import numpy as np

from slidax.motions import (
    AbstractMotion,
    ConstantPosture,
    MinimumJerk,
    Streamed,
    StreamFilter,
    Tabulated,
    ToolMotion,
    Trapezoidal,
)
from tests.paper_examples import MOTION_4_1, MOTION_4_2

TIMES = np.array([0.5, 1.3, 2.0, 3.1])
PLACES = np.array([[0.0, 1.0], [0.8, 0.2], [0.5, -0.4], [-0.3, 0.6]])
SPEEDS = np.array([[0.0, 0.0], [0.4, -1.0], [-0.6, 0.1], [0.0, 0.0]])
CURVES = np.array([[0.5, 0.0], [-1.0, 0.3], [0.0, 2.0], [0.0, -1.0]])
SLOW = StreamFilter.fitting(bandwidth=3.0, velocity=1.0, acceleration=2.0, period=0.01)
SPLINE = MinimumJerk.through(TIMES, PLACES)

TRAJECTORIES: list[tuple[str, AbstractMotion]] = [
    ("constant", ConstantPosture([0.3, -0.7])),
    ("exponential_sum", MOTION_4_1),
    ("sinusoid", MOTION_4_2),
    ("minimum_jerk", MinimumJerk.through(TIMES, PLACES)),
    ("minimum_jerk_within", MinimumJerk.within(PLACES, velocity=1.0, acceleration=[2.0, 4.0], start=0.3)),
    ("trapezoidal", Trapezoidal.through(PLACES, velocity=1.0, acceleration=[2.0, 4.0], start=0.3)),
    ("s_curve", Trapezoidal.through(PLACES, velocity=1.0, acceleration=[2.0, 4.0], jerk=20.0)),
    ("tabulated", Tabulated.through(TIMES, PLACES)),
    ("tabulated_with_velocities", Tabulated.through(TIMES, PLACES, SPEEDS, acceleration=40.0)),
    ("tabulated_with_accelerations", Tabulated.through(TIMES, PLACES, SPEEDS, CURVES)),
    ("streamed", Streamed.through(TIMES, PLACES, SLOW)),
    ("tool_motion", ToolMotion(SPLINE.times, SPLINE.coefficients)),
]

LIKE_OTHERS = ("minimum_jerk", "trapezoidal", "tabulated", "tabulated_with_velocities", "tool_motion")
"""The same classes with other numbers: these run in the long version."""
