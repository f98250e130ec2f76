import numpy as np
import pytest

import slidax
from slidax import scenarios
from slidax.analysis import envelope_margin, rms_error, steady_error
from slidax.core.errors import DefinitionError, DefinitionWarning

GAIN = "scheme.surface.k1"


@pytest.fixture(scope="module")
def scenario():
    return scenarios.load("example-4.1-1khz", {"simulation.t1": 0.5})


def test_set_in_python_equals_the_option_of_the_command(scenario):
    changed = scenario.set({GAIN: 0.4, "start.q[0]": 0.05})
    loaded = scenarios.load("example-4.1-1khz", {"simulation.t1": 0.5, GAIN: 0.4, "start.q[0]": 0.05})
    assert changed.description == loaded.description != scenario.description
    with pytest.raises(DefinitionError, match="`replace` changed `t1`, which `set` would lose"):
        scenario.replace(t1=0.2).set({GAIN: 0.4})


def test_a_run_of_a_sweep_equals_the_single_run_with_its_values(scenario):
    gains = [0.5, 0.2, 0.35]
    runs = scenario.sweep({GAIN: gains, "start.q": [[0.1, 2.1], [0.0, 2.1], [0.1, 2.0]]})
    assert len(runs) == 3
    alone = scenario.set({GAIN: 0.2, "start.q": [0.0, 2.1]}).simulate(progress=False)
    np.testing.assert_allclose(rms_error(runs)[1], rms_error(alone), rtol=1e-9)
    assert not np.allclose(rms_error(runs)[0], rms_error(runs)[1], rtol=1e-4)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({GAIN: [0.1, 0.2], "start.q": [[0.1, 2.1]]}, "the same number of values"),
        ({}, "the same number of values"),
        ({"scheme.surface.k9": [1.0]}, "scheme.surface.k9: there is no `k9` here"),
        ({GAIN: [0.1, -1.0]}, "`SmoothFixedTime.k1` must be > 0"),
        ({"simulation.period": [1e-3, 2e-3]}, "cannot vary within a compiled loop"),
    ],
)
def test_a_sweep_with_unequal_lists_or_invalid_paths_or_values_is_refused(scenario, values, message):
    with pytest.raises(DefinitionError, match=message):
        scenario.sweep(values)


@pytest.mark.parametrize("metric", ["rms_error", rms_error])
def test_the_gradient_of_a_metric_matches_finite_differences(scenario, metric):
    value, slope = scenario.grad(metric, GAIN)
    own, step = 0.2, 1e-4
    assert scenario.description.scheme.surface.k1 == own
    low, high = (np.max(rms_error(scenario.set({GAIN: own + d}).simulate(progress=False))) for d in (-step, step))
    assert value == pytest.approx(np.max(rms_error(scenario.simulate(progress=False))), rel=1e-9)
    assert slope == pytest.approx((high - low) / (2 * step), rel=1e-3)


def test_the_gradient_of_a_margin_is_that_of_the_joint_with_the_least_margin(scenario):
    margins = envelope_margin(scenario.simulate(progress=False))
    value, _ = scenario.grad("envelope_margin", GAIN)
    assert value == pytest.approx(np.min(margins), rel=1e-9) and np.ptp(margins) > 0.0


def test_gradients_with_respect_to_several_paths_are_returned_as_a_mapping(scenario):
    _, slopes = scenario.grad("rms_error", [GAIN, "start.q"])
    assert list(slopes) == [GAIN, "start.q"] and slopes["start.q"].shape == (2,)


def test_a_metric_without_a_derivative_is_refused_with_the_nearest_metric(scenario):
    with pytest.raises(DefinitionError, match="did you mean `steady_error`"):
        scenario.grad("stedy_error", GAIN)
    with pytest.raises(DefinitionError, match="no metric with a derivative `envelope_violations`"):
        scenario.grad("envelope_violations", GAIN)
    with pytest.raises(DefinitionError, match="compiled into the simulation loop"):
        scenario.grad("rms_error", "simulation.period")


def test_new_makes_a_scenario_that_stays_inside_and_warns_of_assumptions():
    scenario = slidax.new("examples/robots/small_arm.urdf", rate=500).set({"simulation.t1": 2.5})
    run = scenario.simulate(progress=False)
    assert scenario.period == 0.002 and run.outcome.ok and np.max(steady_error(run)) < 1e-3
    with pytest.warns(DefinitionWarning, match="assumed: all joints: no position limits in the file"):
        slidax.new("examples/robots/two_link.urdf")


def test_a_scenario_prints_in_few_lines(scenario):
    lines = repr(scenario).splitlines()
    assert len(lines) == 5 and lines[0].startswith("Scenario `example-4.1-1khz`: Two-link arm at 1 kHz")
    assert "cftsmppc, every 1 ms" in repr(scenario) and "<td>0.5 s</td>" in scenario._repr_html_()
    assert "replaced     t1" in repr(scenario.replace(t1=0.2))
