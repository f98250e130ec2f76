"""Sensors, actuators and the sampled-data block become the described parts, and the law knows them."""

from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

from slidax import scenarios
from slidax.core.errors import DefinitionError
from slidax.law import (
    AbstractEstimator,
    FilteredDifference,
    Kalman,
    Measured,
    MeasurementGate,
    Recovery,
    RobustDifferentiator,
    SampledData,
    SaturatedReaching,
    sampled_data,
)
from slidax.law.kalman import FASTEST_PACE
from slidax.plant import AbstractSensor, Actuator, Delayed, DifferencedEncoders, Encoders, Exact, Lossy, TorqueLimits
from slidax.scenarios import Scenario
from slidax.scenarios.schemes import SCHEMES, switch_scheme
from tests.paper_examples import START_4_1, TWO_LINK_NOMINAL, law_4_1

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
    ({"loss": {"trace": "skips"}}, Lossy(Exact(), pattern=[0, 1])),
]


@pytest.mark.parametrize(("described", "sensor"), SENSORS)
def test_a_sensor_block_builds_the_described_sensor(described, sensor):
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
def test_an_actuator_block_builds_the_described_actuator(described, actuator):
    assert eqx.tree_equal(loaded(actuator=described).plant.actuator, actuator)


def test_the_default_sensor_seed_is_zero_and_an_outage_begins_at_the_nearest_sample():
    sensor = loaded(
        {"loss": {"outages": [{"start": 0.0299, "samples": 1}]}}, **{"simulation.period": 2e-3}
    ).plant.sensor
    np.testing.assert_array_equal(sensor.starts, [15])
    assert int(sensor.seed) == 0


def test_the_law_gets_delay_dead_time_and_limits_of_the_instruments():
    actuator = {"torque": [60, 30], "rate": 4000, "dead_time": 0.75, "time_constant": 1e-3}
    law = loaded({"delay": 1.5, "jitter": 0.5}, actuator).controller
    assert (law.delay, law.dead_time) == (2.25, 0.75)
    assert eqx.tree_equal(law.limits, TorqueLimits([60.0, 30.0], 4000.0))
    ideal = loaded().controller
    assert (ideal.delay, ideal.dead_time) == (0.0, 0.0) and eqx.tree_equal(ideal.limits, TorqueLimits())


def test_a_law_without_sampled_data_form_runs_with_a_sensor_and_an_actuator():
    changes = {"simulation.mode": "held", "simulation.t1": 0.05, "sensor.resolution": 1e-4, "actuator.torque": 50}
    run = scenarios.load("example-4.1", changes).simulate(log_every=1)
    assert run.outcome.ok and run.log is not None and np.abs(run.log.tau).max() == 50
    free = scenarios.load("example-4.1", {**changes, "sensor": {}, "actuator": {}}).simulate(log_every=None)
    assert np.asarray(free.tally.peak_torque).max() > 100


def test_the_option_outside_decides_if_a_start_outside_the_envelope_is_refused():
    assert scenarios.load("example-4.1").stepping.outside == "raise"
    assert scenarios.load(NAME).stepping.outside == "recover"
    start = {"start.q": [5.0, 5.0], "simulation.t1": 0.01}
    assert scenarios.load(NAME, start).simulate(log_every=None).outcome.kind == "left_envelope"
    with pytest.raises(DefinitionError, match="must start inside the envelope"):
        scenarios.load(NAME, start | {"simulation.outside": "raise"}).simulate(log_every=None)


def test_equal_seeds_give_equal_runs_and_other_seeds_other_runs():
    def torque_travel(seed: int) -> Any:
        changes = {"sensor": {"position_noise": 1e-6, "seed": seed}, "simulation.t1": 0.05}
        return scenarios.load(NAME, changes).simulate(log_every=None).tally.torque_travel

    np.testing.assert_array_equal(torque_travel(1), torque_travel(1))
    assert np.any(np.asarray(torque_travel(1)) != np.asarray(torque_travel(2)))


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
def test_a_sensor_selected_by_kind_equals_the_sensor_of_the_short_fields(flat, instrument):
    """The laws are compared as well: the default estimator depends on the measured signals and their accuracy."""
    block = {"delay": 1.0, "loss": {"probability": 0.01}}
    short, other = (
        scenarios.load("example-4.1-1khz", {"sensor": {**block_of, **block}})
        for block_of in (flat, {"instrument": instrument})
    )
    assert eqx.tree_equal(short.plant.sensor, other.plant.sensor)
    assert eqx.tree_equal(short.controller, other.controller)


def test_encoder_fields_together_with_another_sensor_are_refused():
    sensor = {"resolution": 1e-5, "instrument": {"kind": "exact"}}
    with pytest.raises(
        DefinitionError, match=r"^sensor.resolution: describes encoders, and `instrument` another sensor"
    ):
        scenarios.load("example-4.1-1khz", {"sensor": sensor})


PRINTED = law_4_1(layer=0.0)
MASS = TWO_LINK_NOMINAL.mass(START_4_1.q)
SLIDING = ["cftsmppc", "ftsmc", "ftsmppc", "sfsmc", "sfsmppc", "slotine_li", "slotine_li_ppc"]


def law(block: dict[str, Any], **changes: Any) -> SampledData:
    built = scenarios.load(NAME, {"scheme.sampled_data": block, **changes}).controller
    assert isinstance(built, SampledData)
    return built


def by_hand(**changes: Any) -> SampledData:
    options: dict[str, Any] = {
        "period": 1e-3,
        "limits": TorqueLimits(60.0, 4000.0),
        "delay": 1.0,
        "recovery": Recovery(),
        "gate": MeasurementGate.of_arm(TWO_LINK_NOMINAL, torque=60.0, mass=MASS, spread=1e-8 * jnp.ones(2)),
    }
    return sampled_data(PRINTED, **options | changes)


FORMS: list[tuple[dict[str, Any], dict[str, Any]]] = [
    ({}, {}),
    ({"horizon": 0.02}, {"horizon": 0.02}),
    ({"slopes": False}, {"slopes": False}),
    ({"recovery": None}, {"recovery": None}),
    ({"recovery": {}}, {}),
    ({"recovery": {"deadline": 0.5, "room": 2, "share": 0.1}}, {"recovery": Recovery(0.5, 2.0, 0.1)}),
    ({"estimator": {"kind": "measured", "gain": 0.3}}, {"estimator": Measured.critical(0.3, 2.0)}),
]


@pytest.mark.parametrize(("block", "changes"), FORMS)
def test_a_sampled_data_block_builds_the_described_form(block, changes):
    assert eqx.tree_equal(law({"adaptation": None, **block}), by_hand(**changes))


ESTIMATOR_BLOCKS: list[tuple[dict[str, Any], AbstractEstimator]] = [
    ({"kind": "measured"}, Measured.critical(1.0 / 6.0, 2.0)),
    ({"kind": "measured", "gain": 0.4}, Measured.critical(0.4, 2.0)),
    ({"kind": "measured", "gain": [0.3, 0.4], "trend": 0.0}, Measured([0.3, 0.4], 0.0, 2.0)),
    ({"kind": "kalman"}, Kalman.of_arm(MASS, variance=1e-18, period=1e-3, fastest=FASTEST_PACE)),
    (
        {"kind": "kalman", "torque_density": [0.1, 0.2], "variance": 1e-12},
        Kalman.of_arm(MASS, variance=1e-12, period=1e-3, torque_density=jnp.array([0.1, 0.2])),
    ),
    ({"kind": "filtered_difference", "cutoff": 300}, FilteredDifference(300.0, 0.25)),
    ({"kind": "filtered_difference", "cutoff": [300, 200], "gain": 0.4}, FilteredDifference([300.0, 200.0], 0.4)),
    ({"kind": "robust_differentiator", "lipschitz": [50, 80]}, RobustDifferentiator([50.0, 80.0])),
]


@pytest.mark.parametrize(("described", "estimator"), ESTIMATOR_BLOCKS)
def test_an_estimator_block_builds_the_described_estimator(described, estimator):
    assert eqx.tree_equal(law({"estimator": described, "adaptation": None}).estimator, estimator)


def test_default_estimator_for_encoders_alone_is_a_kalman_filter_for_their_resolution_and_noise():
    sensor = {"velocity": "differenced", "resolution": [1e-5, 2e-5], "position_noise": 1e-6}
    variance = jnp.array([1e-10, 4e-10]) / 12 + 1e-12
    wanted = Kalman.of_arm(MASS, variance=variance, period=1e-3, fastest=FASTEST_PACE)
    assert eqx.tree_equal(law({}, sensor=sensor).estimator, wanted, rtol=1e-12)
    # With a velocity sensor the velocity is used, however coarse the encoders are.
    assert isinstance(law({}, sensor=sensor | {"velocity": "measured"}).estimator, Measured)


@pytest.mark.parametrize(
    ("period", "delay", "horizon"),
    [(0.001, 1, 0.012), (0.001, 3, 0.012), (0.01, 0, 0.02), (0.01, 1, 0.03), (0.01, 2.5, 0.0525), (0.02, 3, 0.12)],
)
def test_the_default_horizon_grows_with_the_period_and_the_delay(period, delay, horizon):
    built = law({}, **{"simulation.period": period, "sensor.delay": delay})
    assert float(built.period) == period and float(built.horizon) == pytest.approx(horizon, rel=1e-12)


@pytest.mark.parametrize(
    ("delay", "estimator"),
    [(1, Measured.critical(1.0 / 6.0, 2.0)), (1.5, Measured(1.0 / 6.0)), (3, Measured(1.0 / 6.0))],
)
def test_the_default_estimator_extrapolates_no_trend_over_long_delays(delay, estimator):
    assert eqx.tree_equal(law({}, **{"sensor.delay": delay}).estimator, estimator, rtol=1e-12)


def test_a_scenario_without_a_sampled_data_block_has_the_papers_continuous_law():
    built = scenarios.load(NAME, {"scheme.sampled_data": None}).controller
    assert eqx.tree_equal(built, PRINTED)


@pytest.mark.parametrize("name", SLIDING)
def test_a_scheme_chosen_by_name_keeps_the_files_sampled_data_form(name):
    changes = {"scheme.name": name, "scheme.sampled_data.horizon": 0.015}
    built = scenarios.load(NAME, changes).controller
    plain = scenarios.load(NAME, {"scheme.name": name, "scheme.sampled_data": None}).controller
    assert isinstance(built, SampledData) and float(built.horizon) == 0.015
    assert eqx.tree_equal(built.step.surface, plain.surface)
    assert eqx.tree_equal(built.step.transformation, plain.transformation)
    if name.startswith("slotine_li"):
        assert isinstance(built.step.reaching, SaturatedReaching)
        assert eqx.tree_equal(built.step.reaching.damping, plain.damping)
    else:
        assert eqx.tree_equal((built.step.reaching, built.step.bound), (plain.reaching, plain.bound))


def test_switching_the_scheme_keeps_the_sampled_data_settings_that_the_new_scheme_supports():
    estimator = {"kind": "kalman"}
    scheme = {"name": "cftsmppc", "sampled_data": {"horizon": 0.02, "slopes": False, "estimator": estimator}}
    for name in set(SCHEMES) - {"cftsmppc"}:
        plans = name not in ("anftsmc", "computed_torque", "gravity_pd", "nftsmc", "pid")
        kept = scheme["sampled_data"] if plans else {"estimator": estimator}
        assert switch_scheme(scheme, name) == {"name": name, "sampled_data": kept}
    built = scenarios.load("panda-payload", {"scheme.name": "computed_torque"}).controller
    assert isinstance(built, SampledData) and built.horizon is None and isinstance(built.estimator, Kalman)
