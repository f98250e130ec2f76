"""A bound that nobody gave follows from the arm, its drives and the stated mismatch."""

from __future__ import annotations

import numpy as np
import pytest

from slidax import metrics, scenarios
from slidax._errors import DefinitionError

NONE = {"scheme.bound": {}, "simulation.log_every": 100}


def bound_of(name: str, changes: dict) -> object:
    law = scenarios.load(name, {**NONE, **changes}).controller
    return getattr(law, "step", law).bound


@pytest.mark.parametrize("name", ["panda-payload", "example-4.1-1khz", "example-4.2-1khz"])
def test_a_scenario_holds_without_a_bound_of_its_own(name: str) -> None:
    run = scenarios.load(name, {**NONE, "simulation.t1": 4.0}).simulate()
    assert metrics.envelope_violations(run) == 0


def test_the_printed_law_has_gamma_of_the_stated_mismatch_between_a_fifth_and_a_half() -> None:
    bound = bound_of("example-4.1", {})
    kappa = 1.25  # 20 % model error
    assert float(bound.gamma) == pytest.approx(max(0.2, abs(kappa - 1.0), abs(1.0 / kappa - 1.0)), abs=0.05)
    assert float(bound.b2) > 0


def test_a_heavier_payload_asks_for_more_and_no_more_than_the_drives_have() -> None:
    light, heavy, huge = (
        bound_of("panda-payload", {"robot.plant.load.mass": mass, "robot.plant.mass_factor": 1.0})
        for mass in (2.0, 3.0, 300.0)
    )
    assert float(light.b0) < float(heavy.b0)
    strength = np.linalg.norm([87.0] * 4 + [12.0] * 3)
    assert float(huge.b0 + huge.margin) == pytest.approx(0.25 * strength, rel=1e-3)


def test_what_is_given_stays_and_only_the_rest_is_found() -> None:
    bound = bound_of("panda-payload", {"scheme.bound.b0": 3.0})
    assert float(bound.b0) == 3.0
    assert float(bound.margin) > 0


def test_m1_above_the_m2_that_is_found_is_refused_as_ever() -> None:
    with pytest.raises(DefinitionError, match=r"eq\. 47"):
        bound_of("panda-payload", {"scheme.bound.inverse_inertia_min": 1e6})
