"""Every reaching law: one line here enrols a new one in `tests/laws/test_reaching.py`. All are for two joints."""

from slidax.reaching import AbstractReaching, FixedTimeReaching, SaturatedReaching, TwoPowerReaching

REACHING: list[tuple[str, AbstractReaching]] = [
    ("fixed_time_4_1", FixedTimeReaching(0.1, 1.2, 0.05)),
    ("fixed_time_unit_vector", FixedTimeReaching([1.0, 0.5], 1.5)),
    ("fixed_time_matrix", FixedTimeReaching([[0.2, 0.1], [0.1, 0.4]], 1.2, 0.05)),
    ("two_power_4_2", TwoPowerReaching(5.0, 5.0, 2.5, 0.5)),
    ("two_power_layer", TwoPowerReaching([1.0, 2.0], 0.5, 1.5, 0.8, 0.1)),
    ("saturated_layer", SaturatedReaching([20.0, 10.0], [0.6, 0.8], 0.05)),
    ("saturated_sign", SaturatedReaching(5.0, 0.7, 0.0)),
]
