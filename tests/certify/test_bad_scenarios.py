"""Inadmissible scenarios are refused when they are read, or a certificate names the failing assumption."""

from typing import Any

import pytest

from slidax.certify import admissibility
from slidax.certify.printed import settling_time, ultimate_bound
from slidax.scenarios import load

NEAR = {"simulation.t1": 0.5}
FAILING: list[tuple[Any, str, dict[str, Any], str]] = [
    (admissibility, "example-4.1", {"start.q": [-1.0, 2.5], **NEAR}, "outside the envelope: joint 1"),
    (admissibility, "example-4.1", {"uncertainty": {"start.q": {"around": 0.3}}, **NEAR}, "outside the envelope"),
    (admissibility, "example-4.1", {"uncertainty": {"start.q.1": {"around": 0.11}}, **NEAR}, "joint 2"),
    (admissibility, "example-4.1", {"uncertainty": {"start.q": {"ball": 0.25}}, **NEAR}, "outside the envelope"),
    (admissibility, "example-4.1", {"uncertainty": {"start.q": {"choice": [[0, 2], [5, 2]]}}, **NEAR}, "joint 1"),
    (settling_time, "example-4.1", {"scheme.reaching.layer": 0.01, **NEAR}, "the unit vector"),
    (settling_time, "example-4.1", {"scheme.reaching.layer": 0.0, **NEAR}, "M0 = 2/(m1+m2) I"),
    (settling_time, "example-4.1", {"scheme.reaching.gain": [[1, 0.2], [0.2, 1]], **NEAR}, "K0 is diagonal"),
    (settling_time, "example-4.1", {"start.q": [-1.0, 2.5], **NEAR}, "the start is inside"),
    (settling_time, "example-4.1", {"simulation.mode": "held", **NEAR}, "the torque follows the state at once"),
    (ultimate_bound, "example-4.2", {"disturbance.scale": 20.0, **NEAR}, "u covers"),
    (ultimate_bound, "example-4.1", NEAR, "the law's inertia is the arm's own"),
    (ultimate_bound, "example-4.2", {"simulation.mode": "held", **NEAR}, "the torque follows the state at once"),
]


@pytest.mark.parametrize(
    ("certificate", "name", "changes", "text"),
    [pytest.param(*case, marks=[pytest.mark.full] if k % 3 else []) for k, case in enumerate(FAILING)],
)
def test_certificate_fails_with_the_name_of_the_failing_assumption(certificate, name, changes, text):
    verdict = certificate(load(name, changes))
    assert verdict.holds is False
    assert any(text in line.text for line in verdict.assumptions if line.status == "fails"), verdict.assumptions


def test_start_set_just_inside_the_envelope_is_admissible():
    near = {"uncertainty": {"start.q": {"around": 0.099, "each": "joint"}}, **NEAR}
    verdict = admissibility(load("example-4.1", near))
    assert verdict.holds and verdict.margin == pytest.approx(1 - 0.599 / 0.6)


@pytest.mark.full
def test_wider_envelope_of_the_remedy_is_admissible():
    far = {"start.q": [-1.0, 2.5], **NEAR}
    remedy = admissibility(load("example-4.1", far)).remedies[0]
    assert admissibility(load("example-4.1", {**far, **remedy.changes})).holds


@pytest.mark.full
def test_motion_beyond_speed_or_position_limits_is_not_admissible():
    fast = {"trajectory.frequency": 5.4, "simulation.limits": "ignore", **NEAR}
    verdict = admissibility(load("panda-payload", fast))
    assert [line.text for line in verdict.assumptions if line.status == "fails"] == [
        "speeds of the motion exceed a limit of joint `panda_joint7`"
    ]
    far = {"trajectory.offset": [2.7, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785], "simulation.limits": "ignore", **NEAR}
    verdict = admissibility(load("panda-payload", far))
    assert any("positions" in line.text for line in verdict.assumptions if line.status == "fails")
