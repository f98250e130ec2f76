"""Every transformation: one line enrols a new one in `tests/laws/test_transformations.py`. All are for two joints."""

from slidax.law import AbstractTransformation, Exponential, PrescribedPerformance, Unconstrained
from tests.paper_examples import ENVELOPE_4_1

TRANSFORMATIONS: list[tuple[str, AbstractTransformation]] = [
    ("prescribed_performance_4_1", PrescribedPerformance(ENVELOPE_4_1, 0.2)),
    ("prescribed_performance_exponential", PrescribedPerformance(Exponential([0.8, 0.6], 0.002, 1.0), [0.5, 0.9])),
    ("unconstrained", Unconstrained()),
]

LIKE_OTHERS = ("prescribed_performance_exponential",)
"""The same class around another envelope: it runs in the long version."""
