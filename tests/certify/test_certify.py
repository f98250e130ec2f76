"""All certificates of a scenario together, and the statistical one."""

from __future__ import annotations

import pytest
from scipy.stats import binom

import slidax
from slidax.certify import Verdict, certify, statistical
from slidax.certify import certify as certify_module
from slidax.certify.certificate import certificate
from slidax.core.errors import DefinitionError
from slidax.scenarios import Scenario, load

SHORT = {"simulation.t1": 0.05}


def test_refusal_of_one_certificate_does_not_affect_others(monkeypatch: pytest.MonkeyPatch) -> None:
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


def test_scenario_changed_in_python_is_refused() -> None:
    with pytest.raises(DefinitionError, match="t1"):
        slidax.certify.certify(load("example-4.1", SHORT).replace(t1=0.1))
    assert slidax.certify.certify is certify_module


def test_invalid_set_raises() -> None:
    with pytest.raises(DefinitionError, match="uncertainty"):
        certify(load("example-4.1", {"uncertainty": {"robot.plant.masses": {"between": [-1.0, 1.0]}}, **SHORT}))


@pytest.mark.full
def test_failure_rate_bound_is_exact_if_all_runs_hold() -> None:
    calm = {"uncertainty": {"disturbance.scale": {"between": [0, 1]}}, **SHORT}
    verdict = statistical(load("example-4.1-1khz", calm), runs=64)
    assert verdict.holds and verdict.bound["failures"] == 0
    assert verdict.bound["probability"] == pytest.approx(1 - 0.01 ** (1 / 64))
    assert verdict.margin == verdict.bound["worst_margin"] and verdict.margin > 0
    assert verdict.bound["steady_error"] > 0 and verdict.bound["steady_torque_step"] > 0


def test_failures_are_counted_and_the_search_finds_a_violation() -> None:
    wild = {"uncertainty": {"start.q": {"around": 0.15, "each": "joint"}}, **SHORT}
    verdict = statistical(load("example-4.1-1khz", wild), runs=32)
    assert verdict.holds is False and 0 < verdict.bound["failures"] < 32
    # By the definition of the interval: so few failures have a chance of 1 % at that rate.
    assert binom.cdf(verdict.bound["failures"], 32, verdict.bound["probability"]) == pytest.approx(0.01)
    assert verdict.margin is not None and verdict.margin < 0


def test_statistical_does_not_apply_without_set_or_runs() -> None:
    assert statistical(load("example-4.1", SHORT)).holds is None
    assert statistical(load("example-4.1", SHORT), runs=0).holds is None
