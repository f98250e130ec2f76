"""Verdicts depend on a set and not on its notation: order, equal terms, padding."""

from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from slidax.certify import CERTIFICATES, Verdict, statistical
from slidax.scenarios import Scenario, load

SAMPLED, PRINTED = "example-4.1-1khz", "example-4.2"

TERM = {"kind": "harmonic", "amplitude": [0.8, 0.6], "frequency": [1.0, 2.0], "phase": [0.0, 1.0]}
SET = {
    "robot.plant.masses": {"around": "6 %", "each": "joint"},
    "robot.plant.inertias": {"around": "4 %", "each": "joint"},
    "start.q": {"around": 0.02, "each": "joint"},
    "disturbance.scale": {"between": [0.5, 1.0]},
}
AMPLITUDES = {"between": [-0.4, 0.4]}
NOTHING: dict[str, Any] = {
    "sensor.resolution": {"around": 0.0},
    "robot.plant.lengths": {"around": "0 %", "each": "joint"},
    "actuator.dead_time": {"between": [0.0, 0.0]},
    "disturbance.terms.0.frequency": {"around": 0.0},
}

SLOW = ("torque_budget",)
"""Certificates that simulate or take seconds."""

QUICK = [item for item in CERTIFICATES if item.name not in SLOW]

some = settings(max_examples=4, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck), database=None)


def written(sets: dict[str, Any], terms: int = 1, name: str = SAMPLED, **more: Any) -> Scenario:
    """The scenario with its disturbance split into equal terms, each with an uncertain amplitude."""
    each = {**TERM, "amplitude": [value / terms for value in TERM["amplitude"]]}
    ends = [end / terms for end in AMPLITUDES["between"]]
    split = {f"disturbance.terms.{k}.amplitude": {"between": ends} for k in range(terms)}
    if name == PRINTED:
        return load(name, {"uncertainty": sets, "simulation.t1": 8.0, **more})
    changes = {"disturbance.terms": [each] * terms, "uncertainty": {**split, **sets}, "simulation.t1": 3.0}
    return load(name, {**changes, "scheme.sampled_data.adaptation": None, **more})


def near(verdict: Any, other: Any, within: float) -> bool:
    """True if two verdicts are the same up to rounding."""
    if isinstance(verdict, dict):
        return verdict.keys() == other.keys() and all(near(verdict[key], other[key], within) for key in verdict)
    if isinstance(verdict, list):
        return len(verdict) == len(other) and all(near(a, b, within) for a, b in zip(verdict, other, strict=True))
    if isinstance(verdict, float) and isinstance(other, float):
        return bool(np.isclose(verdict, other, rtol=within, atol=1e-12))
    return bool(verdict == other)


def numbers(verdict: Verdict) -> dict[str, Any]:
    """A verdict without its texts, which name the values of the set."""
    answer = verdict.as_json()
    statuses = sorted(line["status"] for line in answer["assumptions"])
    return {**{key: answer[key] for key in ("holds", "grade", "margin", "bound", "since")}, "statuses": statuses}


@st.composite
def permuted(draw: st.DrawFn, sets: dict[str, Any]) -> dict[str, Any]:
    """A set in another order, with single values as padding."""
    padding = draw(st.lists(st.sampled_from(sorted(NOTHING)), unique=True))
    items = draw(st.permutations([*sets.items(), *((path, NOTHING[path]) for path in padding)]))
    return dict(items)


def test_quick_certificates_do_not_depend_on_order_and_padding_of_a_set():
    plain, other = written(SET), written({**NOTHING, **dict(reversed(SET.items()))})
    for certificate in QUICK:
        assert certificate(plain).as_json() == certificate(other).as_json(), certificate.name


def test_quick_certificates_do_not_depend_on_splitting_a_disturbance_into_equal_terms():
    plain, other = written(SET), written(SET, 3)
    for certificate in QUICK:
        assert near(numbers(certificate(plain)), numbers(certificate(other)), 1e-6), certificate.name


@pytest.mark.full
@some
@given(permuted(SET))
def test_all_certificates_do_not_depend_on_order_and_padding_of_a_set(sets):
    plain, other = written(SET), written(sets)
    for certificate in (*CERTIFICATES, lambda item: statistical(item, 40)):
        assert certificate(plain).as_json() == certificate(other).as_json()
    heavy = {path: item for path, item in SET.items() if path.startswith("robot.plant.masses")}
    plain, other = (written(item, name=PRINTED) for item in (heavy, {**NOTHING_PRINTED, **heavy}))
    for certificate in CERTIFICATES:
        assert certificate(plain).as_json() == certificate(other).as_json(), certificate.name


NOTHING_PRINTED = {"start.q": {"around": 0.0, "each": "joint"}, "disturbance.scale": {"around": 0.0}}


@pytest.mark.full
@settings(some, max_examples=2)
@given(st.integers(2, 8), st.booleans())
def test_all_certificates_do_not_depend_on_equal_or_zero_disturbance_terms(terms, learns):
    more = {"scheme.sampled_data.adaptation": {"kind": "joint_learning"}} if learns else {}
    plain, other = written(SET, **more), written(SET, terms, **more)
    nothing = [{**TERM, "amplitude": [0.0, 0.0]}, {"kind": "step", "value": [0.0, 0.0], "start": 1.0, "end": 1.1}]
    silent = {f"disturbance.terms.{k + 1}.{name}": {"around": 0.0} for k, name in enumerate(("amplitude", "value"))}
    padded = written({**silent, **SET}, **more, **{"disturbance.terms": [TERM, *nothing]})
    for certificate in CERTIFICATES:
        expected = numbers(certificate(plain))
        assert near(expected, numbers(certificate(other)), 1e-4), certificate.name
        assert near(expected, numbers(certificate(padded)), 1e-4), certificate.name


@pytest.mark.full
@pytest.mark.parametrize("learns", [False, True])
def test_larger_set_has_no_smaller_bounds(learns):
    more = {"scheme.sampled_data.adaptation": {"kind": "joint_learning"}} if learns else {}
    sizes = []
    for part in (0.25, 0.5, 1.0):
        sets = {
            "robot.plant.masses": {"around": f"{6 * part} %", "each": "joint"},
            "start.q": {"around": 0.02 * part, "each": "joint"},
            "disturbance.terms.0.amplitude": {"around": 0.4 * part, "each": "joint"},
        }
        scenario = written(sets, **more)
        verdicts = {item.name: item(scenario).bound for item in CERTIFICATES}
        sizes.append(
            {
                "start": verdicts["admissibility"]["start_error"],
                "radius": verdicts["inertia_ratio"]["radius"],
                "needed": [verdicts["robust_torque"]["needed"]],
                "torque": verdicts["torque_budget"]["torque"],
                "step": verdicts["torque_budget"]["torque_step"],
            }
        )
    for small, large in pairwise(sizes):
        for name in small:
            assert (np.asarray(large[name]) >= (1.0 - 1e-9) * np.asarray(small[name])).all(), name


def test_a_set_with_too_many_parameters_to_bound_is_sampled_and_only_tested():
    (robust_torque,) = (certificate for certificate in CERTIFICATES if certificate.name == "robust_torque")
    lines = [line for line in robust_torque(written(SET, 12)).assumptions if "disturbance.terms.0" in line.text]
    assert [line.status for line in lines] == ["tested"]
