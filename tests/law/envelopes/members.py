"""Every performance function: one line here enrols a new one in `tests/laws/test_performance.py`."""

from slidax.law import AbstractPerformance, Exponential, FiniteTime, FixedTime
from tests.paper_examples import ENVELOPE_4_1, ENVELOPE_4_2

PERFORMANCES: list[tuple[str, AbstractPerformance]] = [
    ("fixed_time_4_1", ENVELOPE_4_1),
    ("fixed_time_4_2", ENVELOPE_4_2),
    ("fixed_time_figure_1", FixedTime([0.5, 100.0, 0.5, 100.0], 0.01, [2.0, 2.0, 5.0, 5.0], 2.01)),
    ("exponential", Exponential([0.8, 0.6], 0.002, [1.0, 1.5])),
    ("finite_time", FiniteTime([0.8, 0.6], 0.002, [0.5, 0.4], 0.6)),
]

LIKE_OTHERS = ("fixed_time_4_1", "fixed_time_4_2")
"""The same classes with other numbers: these run in the long version."""
