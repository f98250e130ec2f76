"""Defaults: no loop diverges at any rate, sensor and delay, and a default bound follows from the arm."""

from typing import Any

import numpy as np
import pytest

from scripts.figures.defaults import DELAYS, RATES, SCENARIOS, SENSORS, Setting, diverging, simulated
from slidax import analysis, scenarios
from slidax.core.errors import DefinitionError, DefinitionWarning
from slidax.law import Measured
from slidax.law.joint_loop import LinearLoop
from slidax.plant import TorqueLimits
from slidax.scenarios.default_bound import default_bound

HALF = ("half the torque",)
WORST: list[tuple[str, int, str, float, tuple[str, ...], int]] = [
    # Three in ten of these stayed 0.6 rad off with a gain of 0.5.
    ("panda-payload", 100, "velocity sensor", 1, HALF, 20),
    # Nearly all diverged when the disturbance's trend was extrapolated over four periods.
    ("ur5e-payload", 50, "velocity sensor", 3, ("nothing", *HALF), 8),
    # The payload's coupling between the joints needs a horizon longer than two periods and the delay.
    ("ur5e-payload", 250, "encoders", 2, ("2 kg grasped",), 20),
]


@pytest.mark.parametrize(("name", "rate", "sensor", "delay", "changes", "arms"), WORST)
def test_the_default_tuning_does_not_diverge_in_the_three_hardest_settings(name, rate, sensor, delay, changes, arms):
    setting = Setting(name, rate, sensor, delay)
    assert not diverging(setting, simulated(setting, arms, 5, changes)).any()


@pytest.mark.full
@pytest.mark.parametrize("delay", DELAYS)
@pytest.mark.parametrize("sensor", SENSORS)
@pytest.mark.parametrize("rate", RATES)
@pytest.mark.parametrize("name", SCENARIOS)
def test_the_default_tuning_does_not_diverge_at_any_rate_sensor_and_delay(name, rate, sensor, delay):
    setting = Setting(name, rate, sensor, delay)
    assert not diverging(setting, simulated(setting, 10, 38)).any()


@pytest.mark.full
def test_the_divergence_criterion_detects_an_excessive_estimator_gain():
    eager = {"estimator": {"kind": "measured", "gain": 0.7}}
    setting = Setting("panda-payload", 100, "velocity sensor", 1, tuple({"horizon": 0.02, **eager}.items()))
    assert diverging(setting, simulated(setting, 20, 5, HALF)).sum() >= 2


def loop_of(period: float, delay: float, sensor: dict[str, Any]) -> LinearLoop:
    changes = {"simulation.period": period, "sensor": {**sensor, "delay": delay}, "scheme.sampled_data": {}}
    loop = LinearLoop.of(scenarios.load("example-4.1-1khz", changes).controller, 0)
    assert loop is not None
    return loop


@pytest.mark.parametrize("delay", [0.0, 0.5, 1.0, 1.5, 2.0, 3.0, 5.0])
@pytest.mark.parametrize("period", [0.02, 0.004, 0.001])
def test_default_loops_are_stable_for_inertia_ratios_from_a_third_to_three_halves(period, delay):
    least, largest = loop_of(period, delay, SENSORS["velocity sensor"]).stable_range()
    assert least < 1 / 3 and largest > 1.5


@pytest.mark.parametrize("delay", [0.0, 0.5, 1.0, 1.5, 2.0, 3.0])
@pytest.mark.parametrize("period", [0.02, 0.004, 0.001])
def test_default_loops_with_encoders_are_stable_for_inertia_ratios_from_half_to_five_quarters(period, delay):
    exact = {"velocity": "differenced"}
    for sensor in (exact, SENSORS["encoders"]):
        least, largest = loop_of(period, delay, sensor).stable_range()
        assert least < 0.5 and largest > 1.25


def test_an_estimator_without_disturbance_trend_leaves_no_undamped_mode_in_the_loop():
    loop = LinearLoop(1e-3, 12.0, 3.0, (0.2, 0.0, 0.0), measures_velocity=True)
    assert loop.radius() < 0.99 and np.all(np.isfinite(loop.stable_range()))


def test_the_default_estimator_gain_respects_its_upper_limit():
    assert float(Measured.tolerant(0.0, 0.1).gain) == 0.1 and float(Measured.tolerant(2.0, 0.1).gain) == 0.1


NONE = {"scheme.bound": {}, "simulation.log_every": 100}


def bound_of(name: str, changes: dict) -> object:
    law = scenarios.load(name, {**NONE, **changes}).controller
    return getattr(law, "step", law).bound


@pytest.mark.parametrize("name", ["panda-payload", "example-4.1-1khz", "example-4.2-1khz"])
def test_a_scenario_with_the_default_uncertainty_bound_stays_inside_the_envelope(name):
    run = scenarios.load(name, {**NONE, "simulation.t1": 4.0}).simulate()
    assert run.outcome.ok and analysis.envelope_violations(run) == 0


def test_the_default_gamma_of_example_4_1_matches_its_stated_inertia_mismatch():
    bound = bound_of("example-4.1", {})
    assert float(bound.gamma) == pytest.approx(0.2, abs=1e-3) and float(bound.b2) > 0


def test_a_heavier_payload_raises_the_default_bound_up_to_a_quarter_of_the_drive_torque():
    strength = 87.0 * 2.0
    bounds = []
    for mass in (3.0, 6.0):
        changes = {"robot.plant.load.mass": mass, "robot.plant.mass_factor": 1.0}
        arms = scenarios.load("panda-payload", changes).description.robot.build()
        strong, weak = (
            default_bound(arms.true, arms.nominal, arms.load, TorqueLimits(torque=torque), sampled=True)
            for torque in (1e4, strength / 7**0.5)
        )
        assert weak["b0"] + weak["margin"] == pytest.approx(0.25 * strength, rel=1e-3)
        bounds.append(strong["b0"])
    assert bounds[1] == pytest.approx(2.0 * bounds[0], rel=0.1)


def test_a_bound_term_in_the_file_is_kept_and_only_missing_terms_are_computed():
    bound = bound_of("panda-payload", {"scheme.bound.b0": 3.0})
    assert float(bound.b0) == 3.0 and float(bound.margin) > 0


def test_a_lower_inverse_inertia_bound_above_the_computed_upper_bound_is_refused():
    with pytest.raises(DefinitionError, match=r"eq\. 47"):
        bound_of("panda-payload", {"scheme.bound.inverse_inertia_min": 1e6})


@pytest.mark.parametrize(("margin", "words"), [(0.5, "need"), (500.0, "all drives together")])
def test_a_too_small_or_too_large_uncertainty_bound_causes_a_warning_with_its_value(margin, words):
    with pytest.warns(DefinitionWarning, match=rf"scheme.bound, of .* gives u = {margin:g} N m .*{words}"):
        scenarios.load("panda-payload", {"scheme.bound.margin": margin})
