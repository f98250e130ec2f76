"""Sensors and actuators in a scenario file become the parts that they describe, and the law is told of them."""

from __future__ import annotations

from typing import Any

import equinox as eqx
import numpy as np
import pytest

from slidax import scenarios
from slidax.core.errors import DefinitionError
from slidax.plant import AbstractSensor, Actuator, Delayed, DifferencedEncoders, Encoders, Exact, Lossy, TorqueLimits
from slidax.scenarios import Scenario

NAME = "example-4.1-1khz"


def loaded(sensor: dict[str, Any] | None = None, actuator: dict[str, Any] | None = None, **changes: Any) -> Scenario:
    return scenarios.load(NAME, {"sensor": sensor or {}, "actuator": actuator or {}} | changes)


SENSORS: list[tuple[dict[str, Any], AbstractSensor | None]] = [
    ({}, None),
    ({"resolution": 0, "position_noise": [0, 0], "delay": 0, "loss": {}}, None),
    ({"resolution": 1e-5}, Encoders(1e-5)),
    ({"velocity_noise": 1e-3}, Encoders(0.0, 0.0, 1e-3)),
    (
        {"resolution": [1e-5, 2e-5], "position_noise": 1e-6, "velocity_noise": [1e-3, 2e-3], "seed": 3},
        Encoders([1e-5, 2e-5], 1e-6, [1e-3, 2e-3], 3),
    ),
    ({"velocity": "differenced"}, DifferencedEncoders(0.0, 0.0, 600.0)),
    (
        {"velocity": "differenced", "resolution": 1e-5, "position_noise": 1e-6, "cutoff": [300, 400], "seed": 4},
        DifferencedEncoders(1e-5, 1e-6, [300.0, 400.0], 4),
    ),
    ({"delay": 1}, Delayed(Exact(), 1.0)),
    ({"jitter": 0.2}, Delayed(Exact(), 0.0, 0.2)),
    ({"delay": 1.5, "jitter": 0.5, "resolution": 1e-5, "seed": 2}, Delayed(Encoders(1e-5, seed=2), 1.5, 0.5, 2)),
    ({"loss": {"probability": 0.1}, "seed": 5}, Lossy(Exact(), 0.1, seed=5)),
    (
        {"loss": {"outages": [{"start": 0.5, "samples": 20}, {"start": 8, "samples": 60}]}, "delay": 1},
        Lossy(Delayed(Exact(), 1.0), 0.0, [500, 8000], [20, 60]),
    ),
]


@pytest.mark.parametrize(("described", "sensor"), SENSORS)
def test_a_sensor_is_the_one_that_is_described(described: dict[str, Any], sensor: AbstractSensor | None) -> None:
    assert eqx.tree_equal(loaded(described).plant.sensor, sensor)


ACTUATORS: list[tuple[dict[str, Any], Actuator | None]] = [
    ({}, None),
    ({"torque": None, "rate": None, "time_constant": [0, 0]}, None),
    ({"torque": 60}, Actuator(TorqueLimits(60.0))),
    ({"torque": [60, 30], "rate": 4000}, Actuator(TorqueLimits([60.0, 30.0], 4000.0))),
    ({"rate": [4000, 2000]}, Actuator(TorqueLimits(rate=[4000.0, 2000.0]))),
    ({"time_constant": 2e-3}, Actuator(time_constant=2e-3)),
    ({"time_constant": [2e-3, 0], "dead_time": 1.5}, Actuator(time_constant=[2e-3, 0.0], dead_time=1.5)),
]


@pytest.mark.parametrize(("described", "actuator"), ACTUATORS)
def test_an_actuator_is_the_one_that_is_described(described: dict[str, Any], actuator: Actuator | None) -> None:
    assert eqx.tree_equal(loaded(actuator=described).plant.actuator, actuator)


def test_a_sensor_without_seed_has_the_seed_zero_and_an_outage_begins_at_the_nearest_sample() -> None:
    sensor = loaded(
        {"loss": {"outages": [{"start": 0.0299, "samples": 1}]}}, **{"simulation.period": 2e-3}
    ).plant.sensor
    np.testing.assert_array_equal(sensor.starts, [15])
    assert int(sensor.seed) == 0


def test_the_law_is_told_of_delay_dead_time_and_limits() -> None:
    actuator = {"torque": [60, 30], "rate": 4000, "dead_time": 0.75, "time_constant": 1e-3}
    law = loaded({"delay": 1.5, "jitter": 0.5}, actuator).controller
    assert (law.delay, law.dead_time) == (2.25, 0.75)
    assert eqx.tree_equal(law.limits, TorqueLimits([60.0, 30.0], 4000.0))
    ideal = loaded().controller
    assert (ideal.delay, ideal.dead_time) == (0.0, 0.0)
    assert eqx.tree_equal(ideal.limits, TorqueLimits())


def test_a_printed_law_too_can_have_a_sensor_and_an_actuator() -> None:
    changes = {"simulation.mode": "held", "simulation.t1": 0.05, "sensor.resolution": 1e-4, "actuator.torque": 50}
    run = scenarios.load("example-4.1", changes).simulate(log_every=1)
    assert run.outcome.ok
    assert run.log is not None
    assert np.abs(run.log.tau).max() == 50
    free = scenarios.load("example-4.1", {**changes, "sensor": {}, "actuator": {}}).simulate(log_every=None)
    assert np.asarray(free.tally.peak_torque).max() > 100


def test_the_files_word_on_what_happens_outside_is_what_the_run_does() -> None:
    assert scenarios.load("example-4.1").stepping.outside == "raise"
    assert scenarios.load(NAME).stepping.outside == "recover"
    start = {"start.q": [5.0, 5.0], "simulation.t1": 0.01}
    assert scenarios.load(NAME, start).simulate(log_every=None).outcome.kind == "left_envelope"
    with pytest.raises(DefinitionError, match="must start inside the envelope"):
        scenarios.load(NAME, start | {"simulation.outside": "raise"}).simulate(log_every=None)


def test_the_same_seed_gives_the_same_run_and_another_one_another() -> None:
    def aice(seed: int) -> Any:
        changes = {"sensor": {"position_noise": 1e-6, "seed": seed}, "simulation.t1": 0.05}
        return scenarios.load(NAME, changes).simulate(log_every=None).tally.torque_travel

    np.testing.assert_array_equal(aice(1), aice(1))
    assert np.any(np.asarray(aice(1)) != np.asarray(aice(2)))


@pytest.mark.parametrize(
    ("flat", "instrument"),
    [
        (
            {"resolution": 1e-4, "velocity_noise": 1e-3},
            {"kind": "encoders", "resolution": 1e-4, "velocity_noise": 1e-3},
        ),
        (
            {"resolution": 1e-5, "velocity": "differenced"},
            {"kind": "differenced_encoders", "resolution": 1e-5, "cutoff": 600.0},
        ),
    ],
)
def test_a_sensor_by_its_kind_is_the_one_that_the_short_fields_describe(flat: Any, instrument: Any) -> None:
    """With the law's own estimator, which goes by what is measured and how well."""
    block = {"delay": 1.0, "loss": {"probability": 0.01}}
    one, other = (
        scenarios.load("example-4.1-1khz", {"sensor": {**said, **block}}) for said in (flat, {"instrument": instrument})
    )
    assert eqx.tree_equal(one.plant.sensor, other.plant.sensor)
    assert eqx.tree_equal(one.controller, other.controller)


def test_encoders_and_another_sensor_are_not_both_described() -> None:
    sensor = {"resolution": 1e-5, "instrument": {"kind": "exact"}}
    with pytest.raises(
        DefinitionError, match=r"^sensor.resolution: describes encoders, and `instrument` another sensor"
    ):
        scenarios.load("example-4.1-1khz", {"sensor": sensor})
