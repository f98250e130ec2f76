"""`explain` names the cause of a seeded fault, and estimates from the log agree with the arm."""

import json
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from slidax.analysis import RunRecord, explain, forecast
from slidax.analysis.log_estimate import believed_inertia, encoder_resolution, estimate_from_log
from slidax.analysis.loop_causes import EncoderCause, EstimatorCause, InertiaCause, torque_step_noise
from slidax.analysis.torque_causes import ContactCause, PayloadEstimate, _cover_remedies, _payload_remedies
from slidax.arms import panda
from slidax.core.errors import DefinitionError
from slidax.law.joint_loop import LinearLoop
from slidax.scenarios import Scenario, load, names

PANDA = "panda-payload"
ESTIMATOR = "scheme.sampled_data.estimator"
UNLEARNT: dict[str, Any] = {"scheme.sampled_data.adaptation": None}
"""These runs must fail, so the law must not learn the inertia of its arm."""

SEEDED: dict[str, tuple[str, dict[str, Any], str]] = {
    "too light a model": (PANDA, {"robot.nominal.armature": 0.01, "robot.plant.armature": 0.1}, "inertia"),
    "too heavy a model": (PANDA, {"robot.plant.armature": 0.02}, "inertia"),
    "torque limit": (PANDA, {"actuator.torque": [87, 50, 40, 25, 12, 12, 12]}, "torque"),
    "torque rate limit": (PANDA, {"actuator.rate": 100}, "torque_rate"),
    "robust torque": (PANDA, {"scheme.bound.margin": 1.0}, "robust_torque"),
    "long period": (
        PANDA,
        {"simulation.period": 1.6e-2, "simulation.substeps": 40, "scheme.sampled_data.horizon": None},
        "period",
    ),
    "coarse substeps": (
        PANDA,
        # Finer steps keep the run inside this envelope, so the step size is the only fault.
        {
            "simulation.period": 8e-3,
            "simulation.substeps": 1,
            "scheme.sampled_data.horizon": None,
            "scheme.performance": {
                "kind": "fixed_time",
                "initial": 1.0,
                "final": 0.01,
                "deadline": 2.0,
                "exponent": 2.01,
            },
        },
        "substeps",
    ),
    "heavy payload": ("ur5e-payload", {"robot.plant.load.mass": 10.0}, "payload"),
    "slow estimator": (PANDA, {f"{ESTIMATOR}.torque_density": 1e-8}, "estimator"),
    "delay": (PANDA, {"sensor.delay": 4, "scheme.sampled_data.delay": 1}, "delay"),
    "coarse encoder": (PANDA, {"sensor.resolution": 1e-3}, "encoder"),
    "contact": ("panda-table", {"surroundings.table.height": 0.5353}, "contact"),
}
"""Faults by name: a scenario, its changes, and the expected cause."""


def seeded(which: str) -> Scenario:
    base, changes, _ = SEEDED[which]
    return load(base, UNLEARNT | changes)


QUICK = ["too light a model", "too heavy a model", "robust torque", "coarse encoder"]


def marked(values, daily):
    return [pytest.param(value, marks=[] if value in daily else [pytest.mark.full]) for value in values]


# One of the faults is a bound that is far too small.
@pytest.mark.filterwarnings("ignore:scheme.bound")
@pytest.mark.parametrize("which", marked(SEEDED, QUICK))
def test_cause_of_a_seeded_fault_is_named_and_its_remedy_holds(which):
    scenario = seeded(which)
    run = scenario.simulate(log_every=1)
    assert not run.outcome.ok
    first = explain(scenario, run)[0]
    assert (first.finding.name, first.tried, first.holds) == (SEEDED[which][2], True, True), first.sentence()


def test_joint_inertia_is_estimated_from_the_log_within_10_percent():
    scenario = seeded("too light a model")
    record = RunRecord.of(scenario, scenario.simulate(log_every=1))
    true = scenario.plant.robot.mass(scenario.state0.q)[6, 6]
    estimate = estimate_from_log(record)
    assert estimate.inertia[6] == pytest.approx(float(true), rel=0.1) and estimate.coherence[6] > 0.95


def test_an_inertia_error_that_the_law_has_learnt_is_not_named_as_a_cause():
    """The model is 20 times too light, but the law has learnt the true inertia."""
    scenario = load("panda-payload", {"robot.nominal.armature": 0.0, "robot.plant.armature": 0.1})
    record = RunRecord.of(scenario, scenario.simulate(log_every=1))
    estimate = estimate_from_log(record)
    assert estimate.nominal[6] < 0.1 * estimate.inertia[6]
    assert believed_inertia(record, estimate)[6] == pytest.approx(estimate.inertia[6], rel=0.2)
    assert InertiaCause().finding(record) is None


@pytest.mark.filterwarnings("ignore:scheme.bound")
def test_lumped_disturbance_of_a_run_is_computed_with_the_learnt_inertia():
    # The law limits its compensation to u, which is this margin.
    u = 1.77
    scenario = load(PANDA, {"scheme.bound.margin": u, "simulation.t1": 1.5})
    record = RunRecord.of(scenario, scenario.simulate(log_every=1))
    assert np.linalg.norm(record.lumped, axis=1).max() == pytest.approx(u, rel=1e-3)


def test_remedy_models_a_payload_within_the_torque_limits_and_reduces_a_heavier_payload():
    estimate = PayloadEstimate(mass=1.4, spread=0.01, explained=0.9, most=7.1, height=0.1)
    (remedy,) = _payload_remedies(SimpleNamespace(scenario=load(PANDA)), estimate)
    assert remedy.changes == {
        "robot.nominal.load": {"mass": 1.4, "center": [0.0, 0.0, 0.1]},
        "robot.plant.load.mass": pytest.approx(0.6),
    }
    heavy = _payload_remedies(SimpleNamespace(scenario=load(PANDA)), replace(estimate, mass=9.0))
    assert all(remedy.changes.keys() == {"robot.plant.load.mass"} for remedy in heavy)


@pytest.mark.full
def test_the_delay_is_estimated_from_the_log():
    scenario = seeded("delay")
    record = RunRecord.of(scenario, scenario.simulate(log_every=1))
    assert abs(estimate_from_log(record).delay - 4.0) <= 0.5


def test_the_encoder_resolution_is_estimated_from_the_log():
    q = np.cumsum(np.random.default_rng(0).normal(scale=5e-3, size=(500, 2)), axis=0)
    q[:, 0] = 1e-3 * np.round(q[:, 0] / 1e-3)
    np.testing.assert_allclose(encoder_resolution(q), [1e-3, 0.0], rtol=1e-9)


def test_tolerated_inertia_ratio_without_delay_and_estimator_agrees_with_its_formula():
    """`κ < 4/(r (4 - r))`, docs/sampled-data.md."""
    for periods in (1.0, 3.0, 12.0):
        loop = LinearLoop(h=1e-3, horizon=periods, believed=0.0, gains=(0.0, 0.0, 0.0), measures_velocity=True)
        limit = 4.0 * periods**2 / (4.0 * periods - 1.0)
        # The disturbance is not estimated and keeps its value: its eigenvalue of 1 is left out.
        matrix = loop.maps(0.99 * limit, 0.0).step
        assert np.sort(np.abs(np.linalg.eigvals(matrix)))[-3] < 1.0 and loop.radius(1.01 * limit) > 1.0


def test_loop_with_an_exact_model_and_kalman_filter_is_stable_at_any_known_delay():
    for delay in (0.0, 0.5, 1.0, 2.5, 4.0):
        loop = LinearLoop(h=1e-3, horizon=7.0, believed=delay, gains=(0.2, 0.02, 0.001), measures_velocity=False)
        assert loop.radius() < 1.0 and loop.radius(1.0, delay + 8.0) > 1.0


def test_a_loop_that_is_unstable_with_its_own_model_is_explained_without_a_nan():
    scenario = seeded("too light a model")
    record = RunRecord.of(scenario, scenario.simulate(log_every=1))
    assert InertiaCause().finding(record) is not None
    unstable = LinearLoop(h=1e-3, horizon=7.0, believed=1.0, gains=(3.0, 0.5, 0.5), measures_velocity=False)
    assert unstable.radius() > 1.0
    record.__dict__["loops"] = (unstable,) * record.joints
    encoders = np.array(record.q)
    record.__dict__["q"] = 1e-4 * np.round(encoders / 1e-4)
    inertia, encoder, estimator = (cause().finding(record) for cause in (InertiaCause, EncoderCause, EstimatorCause))
    for finding in (inertia, estimator):
        json.dumps(finding.numbers, allow_nan=False)
        assert "nan" not in finding.evidence and "inf" not in finding.evidence.split()
    assert "unstable even for the inertia in the model" in inertia.evidence
    assert "is unstable (spectral radius" in estimator.evidence
    # The noise of an unstable loop has no bound, so the encoders are not blamed.
    assert (encoder_resolution(record.q) > 0.0).any() and not torque_step_noise(record).any() and encoder is None


def test_explain_names_no_cause_for_a_run_inside_its_envelope():
    scenario = load("example-4.1-1khz", UNLEARNT | {"simulation.t1": 1.0})
    assert explain(scenario, scenario.simulate(log_every=1)) == []


def test_remedy_raises_the_default_bound_margin_from_its_computed_value():
    scenario = load("panda-payload", {"scheme.bound.margin": None, "simulation.t1": 0.1})
    record = RunRecord.of(scenario, scenario.simulate(log_every=1))
    first = _cover_remedies(record, covers=10.0, lacks=20.0)[0]
    margin = float(record.law.step.bound.margin)
    assert first.changes["scheme.bound.margin"] == pytest.approx(margin + 20.0, rel=5e-3)


def test_explain_requires_a_log_of_every_sample_and_a_sampled_data_law():
    scenario = load("example-4.1-1khz", UNLEARNT | {"simulation.t1": 1.0})
    with pytest.raises(DefinitionError, match="log_every=1"):
        explain(scenario, scenario.simulate(log_every=10))
    printed = load("example-4.1", {"simulation.t1": 0.01})
    with pytest.raises(DefinitionError, match="sampled_data"):
        explain(printed, printed.simulate(log_every=1))


@pytest.mark.parametrize("name", marked(names(), ["example-4.1-1khz", "panda-payload"]))
def test_forecast_raises_no_warning_for_a_built_in_scenario(name):
    assert forecast(load(name)) == []


@pytest.mark.filterwarnings("ignore:scheme.bound")
@pytest.mark.parametrize(
    ("which", "words"),
    [
        ("too light a model", "κ"),
        ("too heavy a model", "κ"),
        ("torque limit", "needs"),
        ("robust torque", "u covers"),
        ("coarse substeps", "simulation.substeps"),
        ("slow estimator", "too slow"),
    ],
)
def test_forecast_reports_a_likely_failure_before_the_run(which, words):
    assert any(words in sentence for sentence in forecast(seeded(which)))


def test_forecast_warns_of_an_estimator_whose_noise_exceeds_the_torque_rate_limit():
    density = "scheme.sampled_data.estimator.torque_density"
    (doubt,) = forecast(load("panda-payload", {density: 1e4}))
    assert "so fast" in doubt and "rate limit" in doubt
    # Finer encoders allow a fast estimator.
    assert forecast(load("panda-payload", {density: 1.0, "sensor.resolution": 1e-6})) == []


PERIOD = 2e-3
LEFT = 800


@pytest.fixture(scope="module")
def swung():
    """A Panda whose motion becomes ten times as fast at t = 1.4 s, and its tip's Jacobians and accelerations."""
    robot = panda()
    t = PERIOD * np.arange(1000)
    swing = 0.02 * np.sin(t) + np.where(t > 1.4, 0.1 * (1.0 - np.cos(10.0 * (t - 1.4))), 0.0)
    q = np.array([0.0, -0.3, 0.0, -2.0, 0.0, 1.7, 0.5]) + swing[:, None] * np.array([0, 1.0, 0, 1, 0, -1, 0])
    tips = np.asarray(jax.vmap(robot.tip)(jnp.asarray(q)))
    accelerations = np.gradient(np.gradient(tips, PERIOD, axis=0), PERIOD, axis=0)
    jacobians = np.asarray(jax.vmap(jax.jacfwd(robot.tip))(jnp.asarray(q)))
    return robot, t, q, jacobians, accelerations


def finding(swung, force):
    """Contact diagnosis for a run whose unexplained torque is that of a force on the tip."""
    robot, t, q, jacobians, _ = swung
    record = SimpleNamespace(
        nominal=robot,
        joints=7,
        period=PERIOD,
        left=LEFT,
        t=t,
        q=q,
        unexplained=-np.einsum("kij,ki->kj", jacobians, force),
        scenario=SimpleNamespace(description=SimpleNamespace(surroundings=SimpleNamespace(table=None))),
    )
    return ContactCause().finding(record)


def test_a_sudden_force_is_diagnosed_as_contact(swung):
    force = np.where(swung[1][:, None] > 1.5, np.array([0.0, 0.0, 30.0]), 0.0)
    contact = finding(swung, force)
    assert contact is not None and contact.numbers["force"] == pytest.approx(30.0, rel=0.05)


def test_payload_inertia_in_a_sudden_motion_is_not_diagnosed_as_contact(swung):
    assert finding(swung, -3.0 * swung[4]) is None


def test_force_of_a_payload_heavier_than_the_arm_is_diagnosed_as_contact(swung):
    assert finding(swung, -300.0 * swung[4]) is not None


def test_a_run_of_ten_samples_that_leaves_its_envelope_is_explained():
    changes = {"simulation.t1": 0.01, "start.q": [-0.8, 2.9], "simulation.outside": "recover"}
    scenario = load("example-4.1-1khz", changes)
    run = scenario.simulate(log_every=1)
    assert not run.outcome.ok
    assert all(np.isfinite(finding.finding.weight) for finding in explain(scenario, run))


def test_a_log_of_two_samples_is_refused_by_its_length():
    changes = {"simulation.t1": 0.001, "start.q": [-0.8, 2.9], "simulation.outside": "recover"}
    scenario = load("example-4.1-1khz", changes)
    with pytest.raises(DefinitionError, match=r"three samples or more; the log has 2: make `simulation\.t1` longer"):
        explain(scenario, scenario.simulate(log_every=1))
