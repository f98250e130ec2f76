"""Every trajectory: one line here enrols a new one in `tests/laws/test_trajectories.py`."""

from slidax.trajectories import AbstractTrajectory, Constant, MinimumJerk
from tests.paper import MOTION_4_1, MOTION_4_2

TRAJECTORIES: list[tuple[str, AbstractTrajectory]] = [
    ("constant", Constant([0.3, -0.7])),
    ("exponential_sum", MOTION_4_1),
    ("sinusoid", MOTION_4_2),
    ("minimum_jerk", MinimumJerk.through([0.5, 1.3, 2.0, 3.1], [[0.0, 1.0], [0.8, 0.2], [0.5, -0.4], [-0.3, 0.6]])),
]
