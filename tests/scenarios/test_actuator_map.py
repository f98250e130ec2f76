"""Drives with gains and cross-talk: the law commands what gives the joints' torques, within the limits."""

import numpy as np
import pytest

import slidax as sx
from slidax.certify import certify
from slidax.core.errors import DefinitionError
from slidax.export import export_c
from tests.export.exported import needs_a_compiler
from tests.export.test_exported_law import assert_same_answers

MAP = [[0.8, 0.05], [-0.03, 1.15]]


def run(**changes):
    short = {"simulation.t1": 0.4, "actuator.torque": 200.0, "actuator.rate": 2e5}
    dotted = {key.replace("__", "."): value for key, value in changes.items()}
    scenario = sx.scenarios.load("example-4.1-1khz", short | dotted)
    return scenario, scenario.simulate(log_every=1, progress=False).log


def test_a_known_actuator_map_is_inverted_and_the_motion_stays_unchanged():
    _, plain = run()
    _, mapped = run(actuator__map=MAP)
    np.testing.assert_allclose(mapped.state.q, plain.state.q, atol=1e-9)
    np.testing.assert_allclose(np.asarray(mapped.tau) @ np.array(MAP).T, plain.tau, atol=1e-5)
    _, unknown = run(actuator__true_map=MAP)
    assert np.abs(np.asarray(unknown.state.q) - plain.state.q).max() > 1e-6
    assert np.abs(np.asarray(unknown.tau) @ np.array(MAP).T - plain.tau).max() > 1.0


def test_an_actuators_true_map_changes_the_plant_and_not_the_law():
    scenario, _ = run(actuator__map=MAP, actuator__true_map=[[1.0, 0.0], [0.0, 1.0]])
    np.testing.assert_array_equal(scenario.plant.actuator.map.matrix, np.eye(2))
    np.testing.assert_array_equal(scenario.controller.drives.matrix, MAP)


def test_commands_through_an_actuator_map_stay_within_torque_and_rate_limits():
    scenario, log = run(actuator__map=MAP, actuator__torque=30.0, actuator__rate=2000.0)
    tau = np.asarray(log.tau)
    box = np.asarray(scenario.controller.limits.torque)
    corners = np.array([[a, b] for a in (-1, 1) for b in (-1, 1)]) * box
    largest = np.abs(np.linalg.solve(MAP, corners.T)).max()
    assert largest == pytest.approx(30.0, rel=1e-6) and largest < 30.0
    assert np.abs(tau).max() <= 30.0 and np.abs(np.diff(tau, axis=0)).max() <= 2.0 + 1e-9
    joints = np.asarray(log.tau) @ np.array(MAP).T
    assert (np.abs(joints).max(axis=0) > 0.99 * box).any()


@needs_a_compiler
def test_the_exported_c_law_applies_the_actuator_map_as_python_does(tmp_path):
    scenario, _ = run(actuator__map=MAP)
    export_c(scenario, tmp_path, name="law", golden=False)
    # The simulation has shown that these commands are the joints' torques through the inverse map.
    tau = assert_same_answers(sx.load_export(tmp_path), scenario, 60)
    assert np.isfinite(tau).all()


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"actuator.map": [[1.0, 0.0]]}, "must have 2 rows of 2 numbers"),
        ({"actuator.map": [[0.1, 0.5], [0.0, 1.0]]}, "in row 1 the gain is 0.1 and the cross-talk 0.5"),
        ({"actuator.map": MAP, "scheme.sampled_data": None}, "needs a law that knows its drives"),
    ],
)
def test_an_invalid_or_unsupported_actuator_map_is_refused(changes, words):
    with pytest.raises(DefinitionError, match=words):
        sx.scenarios.load("example-4.1-1khz", changes)


def test_certificates_give_no_verdict_for_a_scenario_with_an_actuator_map():
    certificates = certify(sx.scenarios.load("example-4.1-1khz", {"actuator.map": MAP}))
    assert [verdict.name for verdict in certificates if verdict.holds is not None] == []
    reasons = [verdict.statement for verdict in certificates if verdict.name != "statistical"]
    assert reasons and all("no certificate covers `actuator.map`" in reason for reason in reasons)
