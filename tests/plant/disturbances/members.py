"""Every disturbance: one line here enrols a new one in `tests/laws/test_disturbances.py`. All act on two joints."""

from slidax.plant import (
    AbstractDisturbance,
    Constant,
    ElasticStop,
    Friction,
    Harmonic,
    Ripple,
    Scaled,
    Step,
    Stribeck,
    Sum,
)
from tests.paper_examples import DISTURBANCE_4_1

DISTURBANCES: list[tuple[str, AbstractDisturbance]] = [
    ("constant", Constant([1.0, -0.5])),
    ("harmonic", Harmonic([2.0, 1.0], [1.0, 2.0], 0.3)),
    ("friction", Friction([0.3, 0.2], 0.1, 0.02)),
    ("stribeck", Stribeck([0.3, 0.2], 0.1, 0.02)),
    ("ripple", Ripple([0.3, -0.1], [30.0, 12.0], 0.4)),
    ("elastic_stop", ElasticStop([800.0, 300.0], [-0.2, 0.1], 0.1)),
    ("step", Step([3.0, -1.0], 0.5, 1.5)),
    ("scaled", Scaled(Constant([1.0, 2.0]), -0.5)),
    ("sum", Sum((Constant([1.0, 2.0]), Harmonic([1.0, 1.0], 3.0)))),
    ("example_4_1", DISTURBANCE_4_1),
]
