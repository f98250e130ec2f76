"""Every sensor: one line here enrols a new one in `tests/laws/test_sensors.py`. All are for two joints."""

from slidax.plant import AbstractSensor, Delayed, DifferencedEncoders, Encoders, Exact, Lossy

SENSORS: list[tuple[str, AbstractSensor]] = [
    ("exact", Exact()),
    ("encoders", Encoders(1e-4)),
    ("encoders_noisy", Encoders([1e-5, 0.0], [1e-5, 2e-5], 1e-3, seed=3)),
    ("differenced", DifferencedEncoders(1e-4)),
    ("differenced_noisy", DifferencedEncoders([0.0, 1e-5], 1e-5, [300.0, 500.0], seed=3)),
    ("delayed_one_period", Delayed(Exact(), 1.0)),
    ("delayed_between_samples", Delayed(Encoders(1e-5), 2.3)),
    ("delayed_unevenly", Delayed(DifferencedEncoders(1e-5, 1e-5), 0.4, 1.5)),
    ("lossy_by_chance", Lossy(Exact(), 0.3)),
    ("lossy_by_plan", Lossy(Exact(), starts=[2, 5], counts=[2, 1])),
    ("lossy_by_pattern", Lossy(Exact(), pattern=[0, 1, 1])),
    ("all_at_once", Lossy(Delayed(Encoders(1e-5, 1e-5, 1e-3), 1.5, 0.5), 0.2, [4], [3])),
]

LIKE_OTHERS = (
    "encoders",
    "encoders_noisy",
    "differenced",
    "delayed_one_period",
    "delayed_between_samples",
    "delayed_unevenly",
    "lossy_by_chance",
    "lossy_by_plan",
    "lossy_by_pattern",
)
"""Parts of the others, by themselves: these run in the long version."""
