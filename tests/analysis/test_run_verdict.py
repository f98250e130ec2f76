"""The verdict of a run: its sentence, its facts, and the figure of the bounds' shares."""

import equinox as eqx
import numpy as np
import pytest

from slidax import scenarios
from slidax.analysis.run_verdict import bound_shares, run_verdict
from slidax.report.figures import envelope_share

SHORT = {"simulation.t1": 1.0}


@pytest.fixture(scope="module")
def held():
    scenario = scenarios.load("example-4.1-1khz", SHORT)
    return scenario, scenario.simulate(log_every=1, progress=False)


def test_verdict_names_the_joint_and_time_with_the_largest_share_of_its_bound(held):
    scenario, run = held
    log = run.log
    bound = np.where(log.e >= 0, log.envelope.upper, -log.envelope.lower)
    sample, joint = np.unravel_index(np.argmax(np.abs(log.e) / bound), log.e.shape)
    share = abs(log.e[sample, joint] / bound[sample, joint])
    verdict = run_verdict(scenario, run)
    assert verdict.good
    expected = f"Closest: joint {joint + 1}, {100 * share:.2g} % of its bound at {log.t[sample]:.3g} s."
    assert verdict.sentence == f"Inside the envelope. {expected}"
    assert bound_shares(run).max() == pytest.approx(share)


@pytest.mark.filterwarnings("ignore:scheme.bound, of the model error, gives")
def test_verdict_compares_torques_with_the_limits_of_the_drives(held):
    scenario, run = held
    assert "Torque at its limit (joint 1)." in run_verdict(scenario, run).facts
    strong = scenarios.alter(scenario, {"actuator.torque": 500.0})
    stronger = strong.simulate(progress=False)
    share = float(np.max(stronger.tally.peak_torque)) / 500.0
    facts = " ".join(run_verdict(strong, stronger).facts)
    assert share < 0.9 and f"Torque at most {100 * share:.2g} % of its limit" in facts
    assert "has no limit" in " ".join(run_verdict(scenarios.load("example-4.1", SHORT), run).facts)


def test_verdict_without_a_log_reports_the_remaining_envelope_width(held):
    scenario, run = held
    unlogged = eqx.tree_at(lambda run: run.log, run, None)
    margin = np.min(run.tally.margin)
    assert f"{100 * margin:.2g} % of its width left." in run_verdict(scenario, unlogged).sentence


def test_verdict_of_a_run_outside_its_tolerance_band_is_bad():
    band = {
        "overshoot": 0.9,
        "performance": {"kind": "fixed_time", "initial": 1.0, "final": 0.001, "deadline": 0.2, "exponent": 2.01},
    }
    scenario = scenarios.load("example-4.1", {**SHORT, "scheme.name": "computed_torque", "tolerance": band})
    verdict = run_verdict(scenario, scenario.simulate(progress=False))
    assert not verdict.good and verdict.sentence.startswith("Outside the tolerance band: joint ")
    free = scenarios.alter(scenario, {"tolerance": None})
    assert run_verdict(free, free.simulate(progress=False)).sentence.endswith("its controller has no envelope.")


def test_envelope_share_figure_shows_every_joint_and_labels_the_largest_share(held):
    run = held[1]
    figure = envelope_share(run)
    (axes,) = figure.axes
    curves = [line for line in axes.lines if len(line.get_xdata()) > 2]
    assert {line.get_label() for line in curves} == {"joint 1", "joint 2"}
    assert max(np.max(line.get_ydata()) for line in curves) == pytest.approx(100 * bound_shares(run).max())
    assert any("% at" in text.get_text() for text in axes.texts)


def test_verdict_of_a_run_inside_its_envelope_but_outside_its_tolerance_band_is_bad(held):
    scenario, _ = held
    performance = {"kind": "fixed_time", "initial": 1.0, "final": 1e-6, "deadline": 0.5, "exponent": 2.01}
    narrow = scenarios.alter(scenario, {"tolerance": {"overshoot": 0.9, "performance": performance}})
    run = narrow.simulate(progress=False)
    assert np.min(run.tally.margin) > 0.0
    verdict = run_verdict(narrow, run)
    assert not verdict.good and verdict.sentence.startswith("Outside the tolerance band: joint ")
