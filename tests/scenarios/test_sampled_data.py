"""The block `sampled_data` of a scheme becomes its sampled-data form, which fits the sensor and the actuator."""

from __future__ import annotations

from typing import Any

import equinox as eqx
import jax.numpy as jnp
import pytest

from slidax import scenarios
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
from slidax.plant import TorqueLimits
from slidax.scenarios.schemes import SCHEMES, switch_scheme
from tests.paper_examples import START_4_1, TWO_LINK_NOMINAL, law_4_1

NAME = "example-4.1-1khz"
PRINTED = law_4_1(layer=0.0)
MASS = TWO_LINK_NOMINAL.mass(START_4_1.q)
SLIDING = ["cftsmppc", "ftsmc", "ftsmppc", "sfsmc", "sfsmppc", "slotine_li", "slotine_li_ppc"]


def law(block: dict[str, Any], **changes: Any) -> SampledData:
    built = scenarios.load(NAME, {"scheme.sampled_data": block, **changes}).controller
    assert isinstance(built, SampledData)
    return built


def by_hand(**changes: Any) -> SampledData:
    given: dict[str, Any] = {
        "period": 1e-3,
        "limits": TorqueLimits(60.0, 4000.0),
        "delay": 1.0,
        "recovery": Recovery(),
        "gate": MeasurementGate.of_arm(TWO_LINK_NOMINAL, torque=60.0, mass=MASS, spread=1e-8 * jnp.ones(2)),
    }
    return sampled_data(PRINTED, **given | changes)


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
def test_the_form_is_the_one_that_is_described(block: dict[str, Any], changes: dict[str, Any]) -> None:
    assert eqx.tree_equal(law({"adaptation": None, **block}), by_hand(**changes))


ESTIMATORS: list[tuple[dict[str, Any], AbstractEstimator]] = [
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


@pytest.mark.parametrize(("described", "estimator"), ESTIMATORS)
def test_an_estimator_is_the_one_that_is_described(described: dict[str, Any], estimator: AbstractEstimator) -> None:
    assert eqx.tree_equal(law({"estimator": described, "adaptation": None}).estimator, estimator)


def test_with_encoders_alone_the_estimator_is_a_kalman_filter_for_their_resolution_and_noise() -> None:
    sensor = {"velocity": "differenced", "resolution": [1e-5, 2e-5], "position_noise": 1e-6}
    variance = jnp.array([1e-10, 4e-10]) / 12 + 1e-12
    wanted = Kalman.of_arm(MASS, variance=variance, period=1e-3)
    assert eqx.tree_equal(law({}, sensor=sensor).estimator, wanted)
    # With a velocity sensor the velocity is used, however coarse the encoders are.
    assert isinstance(law({}, sensor=sensor | {"velocity": "measured"}).estimator, Measured)


@pytest.mark.parametrize(
    ("period", "delay", "horizon"),
    [(0.001, 1, 0.012), (0.001, 3, 0.012), (0.01, 0, 0.02), (0.01, 1, 0.03), (0.01, 2.5, 0.0525), (0.02, 3, 0.12)],
)
def test_the_default_horizon_grows_with_the_period_and_the_delay(period: float, delay: float, horizon: float) -> None:
    built = law({}, **{"simulation.period": period, "sensor.delay": delay})
    assert float(built.period) == period
    assert float(built.horizon) == pytest.approx(horizon, rel=1e-12)


@pytest.mark.parametrize(
    ("delay", "estimator"),
    [(1, Measured.critical(1.0 / 6.0, 2.0)), (1.5, Measured(1.0 / 6.0)), (3, Measured(1.0 / 6.0))],
)
def test_the_default_estimator_extrapolates_no_trend_over_long_delays(delay: float, estimator: Measured) -> None:
    assert eqx.tree_equal(law({}, **{"sensor.delay": delay}).estimator, estimator, rtol=1e-12)


def test_without_the_block_the_law_is_the_printed_one() -> None:
    built = scenarios.load(NAME, {"scheme.sampled_data": None}).controller
    assert eqx.tree_equal(built, PRINTED)


@pytest.mark.parametrize("name", SLIDING)
def test_another_scheme_by_name_keeps_its_sampled_data_form(name: str) -> None:
    changes = {"scheme.name": name, "scheme.sampled_data.horizon": 0.015}
    built = scenarios.load(NAME, changes).controller
    plain = scenarios.load(NAME, {"scheme.name": name, "scheme.sampled_data": None}).controller
    assert isinstance(built, SampledData)
    assert float(built.horizon) == 0.015
    assert eqx.tree_equal(built.step.surface, plain.surface)
    assert eqx.tree_equal(built.step.transformation, plain.transformation)
    if name.startswith("slotine_li"):
        assert isinstance(built.step.reaching, SaturatedReaching)
        assert eqx.tree_equal(built.step.reaching.damping, plain.damping)
    else:
        assert eqx.tree_equal((built.step.reaching, built.step.bound), (plain.reaching, plain.bound))


def test_every_scheme_keeps_the_block_but_for_what_only_plans_have() -> None:
    estimator = {"kind": "kalman"}
    scheme = {"name": "cftsmppc", "sampled_data": {"horizon": 0.02, "slopes": False, "estimator": estimator}}
    for name in set(SCHEMES) - {"cftsmppc"}:
        plans = name not in ("anftsmc", "computed_torque", "gravity_pd", "nftsmc", "pid")
        kept = scheme["sampled_data"] if plans else {"estimator": estimator}
        assert switch_scheme(scheme, name) == {"name": name, "sampled_data": kept}
    built = scenarios.load("panda-payload", {"scheme.name": "computed_torque"}).controller
    assert isinstance(built, SampledData) and built.horizon is None and isinstance(built.estimator, Kalman)
