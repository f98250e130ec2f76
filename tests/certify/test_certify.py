"""Certificates of a scenario: none claims more than was computed."""

from typing import Any

import numpy as np
import pytest
from scipy.stats import binom

from slidax.certify import CERTIFICATES, Verdict, admissibility, certify, statistical
from slidax.certify.arm import compute_demand, inertia_ratio, robust_torque
from slidax.certify.certificate import Assumption, certificate
from slidax.certify.motion.admission import tracking_bound
from slidax.certify.printed.printed_law import PrintedLaw, continuous_premises
from slidax.core.errors import DefinitionError
from slidax.scenarios import Scenario, load

SHORT = {"simulation.t1": 0.05}


def test_refusal_of_one_certificate_does_not_affect_others(monkeypatch):
    import importlib

    module = importlib.import_module("slidax.certify.certify")

    @certificate("refuses", "", covers=())
    def refuses(_: Scenario) -> Verdict:
        raise DefinitionError("there is no such thing")

    @certificate("broken", "", covers=())
    def broken(_: Scenario) -> Verdict:
        raise ZeroDivisionError

    @certificate("fine", "", covers=())
    def fine(_: Scenario) -> Verdict:
        return Verdict("fine", "fine", True, 0.5, {"x": 1.0}, (), "It holds.")

    scenario = load("example-4.1", SHORT)
    monkeypatch.setattr(module, "CERTIFICATES", (refuses, fine))
    certified = certify(scenario, runs=0)
    assert [verdict.holds for verdict in certified] == [False, True] and not certified.holds
    assert certified.failing == ["refuses"] and "no such thing" in certified["refuses"].statement
    assert certified["fine"].bound == {"x": 1.0}
    monkeypatch.setattr(module, "CERTIFICATES", (broken,))
    with pytest.raises(ZeroDivisionError):
        certify(scenario, runs=0)


def test_scenario_changed_in_python_is_refused():
    changed = load("example-4.1", SHORT).replace(t1=0.1)
    with pytest.raises(DefinitionError, match=r"was changed by `replace` \(t1\)"):
        certify(changed)


def test_uncertainty_set_with_negative_mass_is_refused():
    sets = {"robot.plant.masses": {"between": [-1.0, 1.0]}}
    with pytest.raises(DefinitionError, match=r"^uncertainty\.robot\.plant\.masses: .* must be > 0 kg; got -1"):
        certify(load("example-4.1", {"uncertainty": sets, **SHORT}))


@pytest.mark.full
def test_failure_rate_bound_is_exact_if_all_runs_hold():
    calm = {"uncertainty": {"disturbance.scale": {"between": [0, 1]}}, **SHORT}
    verdict = statistical(load("example-4.1-1khz", calm), runs=64)
    assert verdict.holds and verdict.bound["failures"] == 0
    assert verdict.bound["probability"] == pytest.approx(1 - 0.01 ** (1 / 64))
    assert verdict.margin == verdict.bound["worst_margin"] and verdict.margin > 0
    assert verdict.bound["steady_error"] > 0 and verdict.bound["steady_torque_step"] > 0


def test_failures_of_random_runs_are_counted_and_their_rate_has_its_exact_bound():
    wild = {"uncertainty": {"start.q": {"around": 0.15, "each": "joint"}}, **SHORT}
    verdict = statistical(load("example-4.1-1khz", wild), runs=32)
    assert verdict.holds is False and 0 < verdict.bound["failures"] < 32
    # By the definition of the interval: at that rate, so few failures have a probability of 1 %.
    assert binom.cdf(verdict.bound["failures"], 32, verdict.bound["probability"]) == pytest.approx(0.01)
    assert verdict.margin is not None and verdict.margin < 0


def test_statistical_certificate_does_not_apply_without_a_set_or_runs():
    certain = statistical(load("example-4.1", SHORT))
    assert certain.holds is None and "no uncertainty" in certain.statement
    sets = {"uncertainty": {"disturbance.scale": {"between": [0, 1]}}}
    left_out = statistical(load("example-4.1", SHORT | sets), runs=0)
    assert left_out.holds is None and "no runs were requested" in left_out.statement


NAME = "example-4.1-1khz"
WITHOUT = {"scheme.sampled_data.adaptation": None}
RIPPLE = {"disturbance.terms.1.frequency": 6283.185, "disturbance.terms.1.amplitude": [20.0, 20.0]}

PATHS: list[tuple[str, Any, Any]] = [
    ("sensor.resolution", 8e-5, {"between": [1e-6, 8e-5]}),
    ("sensor.delay", 2.0, {"between": [0.0, 2.0]}),
    ("sensor.loss.probability", 0.1, {"between": [0.0, 0.1]}),
    ("sensor.jitter", 0.1, {"between": [0.0, 0.1]}),
    ("actuator.time_constant", 0.003, {"between": [0.0, 0.003]}),
    ("actuator.dead_time", 0.5, {"between": [0.0, 0.5]}),
    ("actuator.torque", 55.0, {"between": [50.0, 60.0]}),
    ("trajectory.offset", [1.2, 1.25], {"around": 0.01, "each": "joint"}),
]


@pytest.mark.parametrize("block", ["uncertainty", "truth"])
@pytest.mark.parametrize(("path", "value", "uncertainty"), PATHS, ids=[path for path, *_ in PATHS])
def test_certificate_does_not_apply_to_a_path_that_it_does_not_cover(block, path, value, uncertainty):
    scenario = load(NAME, {block: {path: uncertainty if block == "uncertainty" else value}, "simulation.t1": 3.0})
    for verdict in (inertia_ratio(scenario, compute_demand(scenario)), tracking_bound(scenario)):
        assert verdict.holds is None and verdict.grade is None
        assert f"`{path}`" in verdict.statement and f"`{block}`" in verdict.statement


def test_no_certificate_holds_for_a_set_that_it_does_not_cover():
    paths = {path: entry for path, _, entry in PATHS}
    certified = certify(load(NAME, {"uncertainty": paths, "simulation.t1": 3.0}), runs=0)
    assert {entry.name for entry in certified} == {entry.name for entry in CERTIFICATES}
    for verdict in certified:
        assert verdict.holds is None, verdict.name


def test_set_of_single_values_leaves_the_robust_torque_verdict_unchanged():
    sets = {"sensor.resolution": {"around": 0.0}, "robot.plant.masses": {"around": "0 %", "each": "joint"}}
    with_it = load(NAME, {"uncertainty": sets, "simulation.t1": 3.0})
    assert robust_torque(with_it).as_json() == robust_torque(load(NAME, {"simulation.t1": 3.0})).as_json()


def test_disturbance_pulse_between_probe_times_counts_and_an_ineffective_disturbance_is_named():
    pulse = {"kind": "step", "value": [0.0, 0.0], "start": 1.2345, "end": 1.2365}
    sets = {"disturbance.terms.0.value": {"between": [-12.0, 12.0], "each": "joint"}}
    changes = {"disturbance.terms": [pulse], "uncertainty": sets, "simulation.t1": 3.0, **WITHOUT}
    request = compute_demand(load(NAME, changes))
    assert request.effects is not None
    inside = (request.times >= 1.2345) & (request.times < 1.2365)
    assert (np.abs(request.effects).sum(axis=1)[:, inside].min() > 0.1) and inside.sum() == 2
    late = {**pulse, "start": 50.0, "end": 51.0}
    request = compute_demand(load(NAME, {**changes, "disturbance.terms": [late]}))
    assert any("no torque depends on it" in line.text and line.status == "tested" for line in request.assumptions)


@pytest.mark.parametrize(("reach", "statuses"), [(0.6, ["proved"]), (0.9, ["fails"])])
def test_start_is_proved_inside_the_envelope_only_if_all_starts_are_inside(reach, statuses):
    # The initial envelope is 1.2, and the reference is 0.5 from the middle of the starts.
    scenario = load("example-4.2", {"uncertainty": {"start.q": {"around": reach, "each": "joint"}}})
    printed = PrintedLaw.of(scenario)
    assert printed is not None
    for assumptions in (admissibility(scenario).assumptions, continuous_premises(printed)):
        assert [line.status for line in assumptions if "side the envelope" in line.text] == statuses


BRIEF = {
    "trajectory": {"kind": "sinusoid", "offset": [5.0, 0.8], "amplitude": [0.2, 0.2], "frequency": [2.0, 2.0]},
    "start": {"q": [5.0, 0.8], "dq": [0.4, 0.4]},
    "simulation.t1": 1.7,
    **WITHOUT,
}


@pytest.mark.parametrize("position", [None, {"between": [5.1995, 5.6]}], ids=["surface known", "surface uncertain"])
def test_brief_contact_force_counts_with_the_largest_uncertain_stiffness(position):
    # The first joint is 0.5 mrad deep in the surface at t = 0.785 s, and less than 36 ms in contact.
    stop = {"kind": "elastic_stop", "position": [5.1995, 15.0], "stiffness": [20000.0, 0.0], "damping": [0.0, 0.0]}
    sets: dict[str, Any] = {"disturbance.terms.0.stiffness": {"between": [0.0, 40000.0]}}
    if position:
        sets["disturbance.terms.0.position.0"] = position
    touched = compute_demand(load(NAME, {**BRIEF, "disturbance.terms": [stop], "uncertainty": sets}))
    # The stiffest surface presses with 20 N m.
    pressed = compute_demand(load(NAME, {**BRIEF, "disturbance.terms": [{"kind": "constant", "value": [-20.0, 0.0]}]}))
    k = round(0.25 * np.pi / 0.001)
    assert touched.effects is not None
    bound = np.abs(touched.disturbance[:, k]).max(axis=0) + np.abs(touched.effects[:, :, k]).sum(axis=1).max(axis=0)
    assert (bound >= 0.999 * np.abs(pressed.disturbance[0, k])).all()


def test_disturbance_ripple_that_vanishes_at_each_sample_counts_in_the_robust_torque():
    # A sine of 1 kHz sampled at 1 kHz: at each sample its 20 N m vanish.
    verdict = robust_torque(load(NAME, {**RIPPLE, "simulation.t1": 3.0}))
    assert verdict.holds is False and verdict.bound["needed"] > 20.0
    still = robust_torque(load(NAME, {**RIPPLE, "disturbance.terms.1.amplitude": [0.0, 0.0], "simulation.t1": 3.0}))
    assert still.holds and still.bound["needed"] < 15.0


def test_disturbance_pulse_between_two_samples_counts_as_a_jump():
    push = {"kind": "step", "value": [3.0, 0.0], "start": 1.0004, "end": 1.0008}
    request = compute_demand(load(NAME, {"disturbance.terms": [push], "simulation.t1": 3.0, **WITHOUT}))
    assert request.jumps is not None
    k = round(1.0 / 0.001)
    bare = compute_demand(load(NAME, {"disturbance.terms": [], "simulation.t1": 3.0, **WITHOUT}))
    assert request.jumps[k].max() > 0.3 and np.array_equal(request.disturbance[:, k], bare.disturbance[:, k])
    assert not request.jumps[k + 2 :].any() and not request.jumps[: k - 1].any()


def test_grade_depends_on_the_share_of_proved_assumptions():
    def grade(*statuses: Any, holds: bool | None = True) -> str | None:
        return Verdict("", "", holds, None, {}, [Assumption("", line) for line in statuses], "").grade

    assert grade("proved", "proved") == "A" and grade("proved", "tested") == grade("proved", "assumed") == "B"
    assert grade("tested", "assumed") == grade() == "C"
    assert grade("proved", holds=None) is None and grade("proved", "fails", holds=False) is None


@pytest.mark.full
@pytest.mark.parametrize("name", ["panda-payload", "ur5e-payload"])
def test_inertia_ratio_certificate_fails_if_loops_are_stable_only_joint_by_joint(name):
    scenario = load(name)
    verdict = inertia_ratio(scenario, compute_demand(scenario))
    assert np.max(verdict.bound["radius"]) < 1.0 < verdict.bound["radius_together"]
    assert verdict.holds is False and "together" in verdict.statement
