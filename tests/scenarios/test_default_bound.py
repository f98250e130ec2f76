"""A bound that nobody gave follows from the arm, its drives and the stated mismatch."""

from __future__ import annotations

import pytest

from slidax import analysis, scenarios
from slidax.core.errors import DefinitionError, DefinitionWarning
from slidax.plant import TorqueLimits
from slidax.scenarios.default_bound import default_bound

NONE = {"scheme.bound": {}, "simulation.log_every": 100}


def bound_of(name: str, changes: dict) -> object:
    law = scenarios.load(name, {**NONE, **changes}).controller
    return getattr(law, "step", law).bound


@pytest.mark.parametrize("name", ["panda-payload", "example-4.1-1khz", "example-4.2-1khz"])
def test_a_scenario_holds_without_a_bound_of_its_own(name: str) -> None:
    run = scenarios.load(name, {**NONE, "simulation.t1": 4.0}).simulate()
    assert analysis.envelope_violations(run) == 0


def test_the_printed_law_has_the_gamma_of_its_stated_mismatch() -> None:
    bound = bound_of("example-4.1", {})
    assert float(bound.gamma) == pytest.approx(0.2, abs=1e-3)
    assert float(bound.b2) > 0


def test_a_heavier_payload_asks_for_more_and_no_more_than_a_quarter_of_the_drives() -> None:
    strength = 87.0 * 2.0
    found = []
    for mass in (3.0, 6.0):
        changes = {"robot.plant.load.mass": mass, "robot.plant.mass_factor": 1.0}
        arms = scenarios.load("panda-payload", changes).description.robot.build()
        strong, weak = (
            default_bound(arms.true, arms.nominal, arms.load, TorqueLimits(torque=torque), sampled=True)
            for torque in (1e4, strength / 7**0.5)
        )
        assert weak["b0"] + weak["margin"] == pytest.approx(0.25 * strength, rel=1e-3)
        found.append(strong["b0"])
    assert found[1] == pytest.approx(2.0 * found[0], rel=0.1)


def test_what_is_given_stays_and_only_the_rest_is_found() -> None:
    bound = bound_of("panda-payload", {"scheme.bound.b0": 3.0})
    assert float(bound.b0) == 3.0
    assert float(bound.margin) > 0


def test_m1_above_the_m2_that_is_found_is_refused_as_ever() -> None:
    with pytest.raises(DefinitionError, match=r"eq\. 47"):
        bound_of("panda-payload", {"scheme.bound.inverse_inertia_min": 1e6})


@pytest.mark.parametrize(("margin", "said"), [(0.5, "ask for"), (500.0, "all drives together")])
def test_a_bound_of_another_arm_is_noticed_with_numbers(margin: float, said: str) -> None:
    with pytest.warns(DefinitionWarning, match=rf"scheme.bound gives u = {margin:g} N m .*{said}"):
        scenarios.load("panda-payload", {"scheme.bound.margin": margin})
