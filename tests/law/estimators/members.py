"""Every estimator: one line here enrols a new one in `tests/laws/test_estimators.py`. All are for two joints.

All have settled after 2000 periods of 1 ms.
"""

from slidax.law import AbstractEstimator, FilteredDifference, Kalman, Measured, RobustDifferentiator

ESTIMATORS: list[tuple[str, AbstractEstimator]] = [
    ("measured", Measured()),
    ("measured_per_joint", Measured([0.1, 1.0])),
    ("measured_ahead", Measured.critical(0.3, 1.0)),
    ("measured_with_trend", Measured([0.3, 0.5], [0.02, 0.1], 2.0)),
    ("filtered_difference", FilteredDifference(200.0)),
    ("filtered_difference_per_joint", FilteredDifference([100.0, 1000.0], [0.25, 1.0])),
    ("kalman", Kalman.steady(density=1.0, variance=1e-10 / 12, period=1e-3)),
    ("kalman_per_joint", Kalman.steady(density=[1.0, 1e3], variance=[1e-10, 1e-12], period=1e-3)),
    ("robust_differentiator", RobustDifferentiator(50.0)),
    ("robust_differentiator_per_joint", RobustDifferentiator([10.0, 1e4])),
]

LIKE_OTHERS = ("measured", "measured_per_joint", "filtered_difference", "kalman", "robust_differentiator")
"""The same classes with other numbers: these run in the long version."""
