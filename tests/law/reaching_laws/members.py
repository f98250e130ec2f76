"""Every reaching law and bound, for two joints: one line here enrols a new one in `tests/laws/test_reaching.py`."""

from slidax.law import (
    AbstractBound,
    AbstractReaching,
    FixedBound,
    FixedTimeReaching,
    SaturatedReaching,
    StateBound,
    TwoPowerReaching,
    UncertaintyBound,
)

REACHING: list[tuple[str, AbstractReaching]] = [
    ("fixed_time_4_1", FixedTimeReaching(0.1, 1.2, 0.05)),
    ("fixed_time_unit_vector", FixedTimeReaching([1.0, 0.5], 1.5)),
    ("fixed_time_matrix", FixedTimeReaching([[0.2, 0.1], [0.1, 0.4]], 1.2, 0.05)),
    ("two_power_4_2", TwoPowerReaching(5.0, 5.0, 2.5, 0.5)),
    ("two_power_layer", TwoPowerReaching([1.0, 2.0], 0.5, 1.5, 0.8, 0.1)),
    ("saturated_layer", SaturatedReaching([20.0, 10.0], [0.6, 0.8], 0.05)),
    ("saturated_sign", SaturatedReaching(5.0, 0.7, 0.0)),
]

LIKE_OTHERS = ("fixed_time_4_1", "two_power_4_2", "saturated_layer")
"""The same classes with other numbers: these run in the long version."""

BOUNDS: list[tuple[str, AbstractBound]] = [
    ("uncertainty_4_1", UncertaintyBound(0.09, 0.2, 12.0, 2.2, 2.8, 1.0)),
    ("state", StateBound(12.0, 2.2, 2.8)),
    ("fixed", FixedBound(20.0)),
]
