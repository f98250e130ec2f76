"""What is read out of a log: inertia, delay, resolution, and the linearised loop."""

from __future__ import annotations

import numpy as np
import pytest

from slidax.analysis import RunRecord, explain, forecast
from slidax.analysis.log_estimate import believed_inertia, encoder_resolution, estimate_from_log
from slidax.analysis.loop_causes import InertiaCause
from slidax.analysis.torque_causes import _cover_remedies
from slidax.core.errors import DefinitionError
from slidax.law.joint_loop import LinearLoop
from slidax.scenarios import load, names

from .seeded import UNLEARNT, seeded


def test_the_inertia_of_a_joint_is_seen_in_the_log_within_a_few_percent() -> None:
    scenario = seeded("too light a model")
    record = RunRecord.of(scenario, scenario.simulate(log_every=1))
    true = scenario.plant.robot.mass(scenario.state0.q)[6, 6]
    estimate = estimate_from_log(record)
    assert estimate.inertia[6] == pytest.approx(float(true), rel=0.1)
    assert estimate.coherence[6] > 0.95


def test_an_inertia_that_was_learnt_is_not_blamed() -> None:
    """The model is 20 times too light, the law has learnt so, and it is what it learnt that counts."""
    scenario = load("panda-payload", {"robot.nominal.armature": 0.0, "robot.plant.armature": 0.1})
    record = RunRecord.of(scenario, scenario.simulate(log_every=1))
    estimate = estimate_from_log(record)
    assert estimate.nominal[6] < 0.1 * estimate.inertia[6]
    assert believed_inertia(record, estimate)[6] == pytest.approx(estimate.inertia[6], rel=0.2)
    assert InertiaCause().finding(record) is None


@pytest.mark.full
def test_the_delay_is_seen_in_the_log() -> None:
    scenario = seeded("delay")
    record = RunRecord.of(scenario, scenario.simulate(log_every=1))
    assert abs(estimate_from_log(record).delay - 4.0) <= 0.5


def test_the_encoders_steps_are_found_in_their_readings() -> None:
    q = np.cumsum(np.random.default_rng(0).normal(scale=5e-3, size=(500, 2)), axis=0)
    q[:, 0] = 1e-3 * np.round(q[:, 0] / 1e-3)
    np.testing.assert_allclose(encoder_resolution(q), [1e-3, 0.0], rtol=1e-9)


def test_without_delay_and_estimate_the_loop_bears_what_the_derivation_says() -> None:
    """`κ < 4/(r (4 - r))`, docs/sampled-data.md."""
    for periods in (1.0, 3.0, 12.0):
        loop = LinearLoop(h=1e-3, horizon=periods, believed=0.0, gains=(0.0, 0.0, 0.0), measures_velocity=True)
        limit = 4.0 * periods**2 / (4.0 * periods - 1.0)
        # The push that is not estimated stays as it is: one eigenvalue of 1 that says nothing.
        matrix = loop.maps(0.99 * limit, 0.0).step
        assert np.sort(np.abs(np.linalg.eigvals(matrix)))[-3] < 1.0
        assert loop.radius(1.01 * limit) > 1.0


def test_an_exact_model_is_stable_with_the_kalman_filter_at_any_delay_that_is_known() -> None:
    for delay in (0.0, 0.5, 1.0, 2.5, 4.0):
        loop = LinearLoop(h=1e-3, horizon=7.0, believed=delay, gains=(0.2, 0.02, 0.001), measures_velocity=False)
        assert loop.radius() < 1.0
        assert loop.radius(1.0, delay + 8.0) > 1.0


def test_a_run_that_holds_has_nothing_to_explain() -> None:
    scenario = load("example-4.1-1khz", UNLEARNT | {"simulation.t1": 1.0})
    assert explain(scenario, scenario.simulate(log_every=1)) == []


def test_a_margin_that_the_file_leaves_out_is_raised_from_what_was_found_for_the_arm() -> None:
    scenario = load("panda-payload", {"scheme.bound.margin": None, "simulation.t1": 0.1})
    record = RunRecord.of(scenario, scenario.simulate(log_every=1))
    first = _cover_remedies(record, covers=10.0, lacks=20.0)[0]
    found = float(record.law.step.bound.margin)
    assert first.changes["scheme.bound.margin"] == pytest.approx(found + 20.0, rel=5e-3)


def test_diagnosis_refusal_names_the_missing_part() -> None:
    scenario = load("example-4.1-1khz", UNLEARNT | {"simulation.t1": 1.0})
    with pytest.raises(DefinitionError, match="log_every=1"):
        explain(scenario, scenario.simulate(log_every=10))
    printed = load("example-4.1", {"simulation.t1": 0.01})
    with pytest.raises(DefinitionError, match="sampled_data"):
        explain(printed, printed.simulate(log_every=1))


@pytest.mark.parametrize("name", ["example-4.1-1khz", "panda-payload"])
def test_built_in_scenario_raises_no_warning_before_its_run(name: str) -> None:
    assert forecast(load(name)) == []


@pytest.mark.full
@pytest.mark.parametrize("name", names())
def test_all_other_built_in_scenarios_raise_no_warning_before_their_run(name: str) -> None:
    assert forecast(load(name)) == []


@pytest.mark.filterwarnings("ignore:scheme.bound")
@pytest.mark.parametrize(
    ("which", "said"),
    [
        ("too light a model", "κ"),
        ("too heavy a model", "κ"),
        ("torque limit", "needs"),
        ("robust torque", "u covers"),
        ("coarse substeps", "simulation.substeps"),
        ("slow estimator", "too slow"),
    ],
)
def test_likely_failure_is_reported_before_the_run(which: str, said: str) -> None:
    assert any(said in sentence for sentence in forecast(seeded(which)))


def test_a_fast_estimator_is_doubted_where_its_noise_needs_the_drives_rate() -> None:
    density = "scheme.sampled_data.estimator.torque_density"
    (doubt,) = forecast(load("panda-payload", {density: 1e4}))
    assert "so fast" in doubt and "rate limit" in doubt
    # As fast, with encoders as fine as that.
    assert forecast(load("panda-payload", {density: 1.0, "sensor.resolution": 1e-6})) == []
