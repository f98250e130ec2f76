"""All certificates of a scenario together, and what runs drawn by chance say."""

from __future__ import annotations

import pytest
from scipy.stats import binom

import slidax
from slidax._errors import DefinitionError
from slidax.certificates import Verdict, certify, statistical
from slidax.certificates import certify as certify_module
from slidax.certificates.certificate import certificate
from slidax.scenarios import Scenario, load

SHORT = {"simulation.t1": 0.05}


def test_one_certificate_that_refuses_takes_no_other_with_it(monkeypatch: pytest.MonkeyPatch) -> None:
    import importlib

    module = importlib.import_module("slidax.certificates.certify")

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
    found = certify(scenario, runs=0)
    assert [one.holds for one in found] == [False, True] and not found.holds
    assert found.failing == ["refuses"] and "no such thing" in found["refuses"].statement
    assert found["fine"].bound == {"x": 1.0}
    monkeypatch.setattr(module, "CERTIFICATES", (broken,))
    with pytest.raises(ZeroDivisionError):
        certify(scenario, runs=0)


def test_a_scenario_that_no_file_says_is_refused() -> None:
    with pytest.raises(DefinitionError, match="t1"):
        slidax.certify(load("example-4.1", SHORT).replace(t1=0.1))
    assert slidax.certify is certify_module


def test_a_wrong_set_is_a_mistake_of_the_scenario() -> None:
    with pytest.raises(DefinitionError, match="uncertainty"):
        certify(load("example-4.1", {"uncertainty": {"robot.plant.masses": {"between": [-1.0, 1.0]}}, **SHORT}))


@pytest.mark.full
def test_runs_that_all_hold_bound_the_probability_exactly() -> None:
    calm = {"uncertainty": {"disturbance.scale": {"between": [0, 1]}}, **SHORT}
    verdict = statistical(load("example-4.1-1khz", calm), runs=64)
    assert verdict.holds and verdict.bound["failures"] == 0
    assert verdict.bound["probability"] == pytest.approx(1 - 0.01 ** (1 / 64))
    assert verdict.margin == verdict.bound["worst_margin"] and verdict.margin > 0
    assert verdict.bound["steady_error"] > 0 and verdict.bound["steady_torque_step"] > 0


def test_runs_that_leave_are_counted_and_the_search_finds_worse() -> None:
    wild = {"uncertainty": {"start.q": {"around": 0.15, "each": "joint"}}, **SHORT}
    verdict = statistical(load("example-4.1-1khz", wild), runs=32)
    assert verdict.holds is False and 0 < verdict.bound["failures"] < 32
    # By the definition of the interval: so few failures have a chance of 1 % at that rate.
    assert binom.cdf(verdict.bound["failures"], 32, verdict.bound["probability"]) == pytest.approx(0.01)
    assert verdict.margin is not None and verdict.margin < 0


def test_without_a_set_or_an_envelope_nothing_is_said_by_runs() -> None:
    assert statistical(load("example-4.1", SHORT)).holds is None
    assert statistical(load("example-4.1", SHORT), runs=0).holds is None
