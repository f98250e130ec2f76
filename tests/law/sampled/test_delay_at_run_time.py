"""A law whose delay is a parameter that may be changed while it runs."""

import jax.numpy as jnp
import numpy as np
import pytest

import slidax as sx
from slidax import scenarios
from slidax.core.errors import DefinitionError
from slidax.export import export_c
from slidax.law.sampled.prediction import mean_past_torque
from tests.export.exported import needs_a_compiler

SLIDING = {"name": "cftsmppc", "horizon": 0.02}
MIDPOINT = {
    "name": "computed_torque",
    "horizon": 0.03,
    "sampled_data": {"midpoint": True, "adaptation": None, "estimator": {"kind": "kalman"}},
}


def scenario_of(believed, longest=None, true=None, midpoint=False, t1=0.25):
    changes = {
        "sensor.delay": believed if true is None else true,
        "simulation.t1": t1,
        "scheme.sampled_data.estimator": {"kind": "kalman"},
        "scheme.sampled_data.horizon": 0.02,
        "scheme.sampled_data.delay": believed,
    }
    if midpoint:
        changes |= {"scheme": MIDPOINT | {"sampled_data": MIDPOINT["sampled_data"] | {"delay": believed}}}
        del changes["scheme.sampled_data.estimator"], changes["scheme.sampled_data.horizon"]
    if longest is not None:
        changes["scheme.sampled_data.delay_at_most"] = longest
    return scenarios.load("example-4.1-1khz", changes)


@pytest.mark.parametrize("midpoint", [False, True])
@pytest.mark.parametrize("believed", [0.0, 1.0, 1.5, pytest.param(0.5, marks=pytest.mark.full), 3.0])
def test_a_delay_set_at_run_time_gives_the_same_torques_as_a_fixed_delay(believed, midpoint):
    fixed, told = (scenario_of(believed, longest, midpoint=midpoint).simulate() for longest in (None, 3.0))
    np.testing.assert_allclose(told.log.tau, fixed.log.tau, rtol=1e-6, atol=1e-6)
    assert np.ptp(np.asarray(fixed.log.tau)) > 1.0


def test_a_wrong_delay_at_run_time_at_least_doubles_the_error():
    right, wrong = (scenario_of(believed, 3.0, true=3.0, t1=4.0).simulate() for believed in (3.0, 0.0))
    errors = [float(np.max(np.abs(np.asarray(run.log.e)[-200:]))) for run in (right, wrong)]
    assert errors[0] < 0.5 * errors[1]


@pytest.mark.parametrize("delay", [0.0, 0.25, 1.0, 1.5, 2.0])
def test_past_torque_with_a_delay_set_at_run_time_equals_that_of_a_fixed_delay(delay):
    torques = jnp.asarray(np.random.default_rng(0).normal(size=(4, 3)))
    fixed = mean_past_torque(torques, delay)
    np.testing.assert_allclose(mean_past_torque(torques, 2.0, jnp.asarray(delay)), fixed, rtol=1e-12)


@needs_a_compiler
def test_a_parameter_sets_the_delay_of_an_exported_law(tmp_path):
    fixed, told = scenario_of(2.0), scenario_of(1.0, 3.0)
    laws = []
    for name, scenario in (("fixed", fixed), ("told", told)):
        export_c(scenario, tmp_path / name, name="law", golden=False)
        laws.append(sx.load_export(tmp_path / name))
    assert laws[1]["actual_delay"] == 1.0 and "actual_delay" not in laws[0]
    laws[1]["actual_delay"] = 2.0
    reference = [fixed.trajectory.reference(jnp.asarray(k * fixed.period)) for k in range(42)]
    rows = [np.stack([each.q, each.dq, each.ddq]) for each in reference]
    for k in range(40):
        q = rows[max(k - 2, 0)][0] + 1e-3
        answers = [law.step(k * fixed.period, q, rows[k][1], rows[k], rows[k + 1]) for law in laws]
        np.testing.assert_allclose(answers[0][0], answers[1][0], rtol=1e-9)
        assert answers[0][1] == answers[1][1]


@needs_a_compiler
@pytest.mark.full
def test_a_delay_beyond_the_maximum_is_reported_as_an_invalid_parameter(tmp_path):
    export_c(scenario_of(1.0, 3.0), tmp_path, name="law", golden=False)
    law = sx.load_export(tmp_path)
    row = np.zeros((3, 2))
    for delay in (3.5, -1.0, np.nan):
        law.reset()
        law["actual_delay"] = delay
        _, status = law.step(0.0, row[0], row[0], row, row)
        assert "parameters_invalid" in [name.lower() for name in law.conditions(status)]


def test_a_maximum_delay_below_the_delay_is_refused():
    with pytest.raises(DefinitionError, match="delay_at_most: must be at least the delay, 2 periods; got 1"):
        scenario_of(2.0, 1.0)
