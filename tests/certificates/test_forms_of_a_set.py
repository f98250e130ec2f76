"""A verdict is about a set, not about how it is written: permuted, split into equal terms, padded with nothing."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from slidax.certificates import CERTIFICATES, Verdict, statistical
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

SLOW = ("loop_rate", "torque_budget")
"""Certificates that simulate, or need seconds."""

QUICK = [one for one in CERTIFICATES if one.name not in SLOW]

once = settings(max_examples=1, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck), database=None)
some = settings(max_examples=4, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck), database=None)


def written(sets: dict[str, Any], terms: int = 1, name: str = SAMPLED, **more: Any) -> Scenario:
    """The scenario with its disturbance in so many equal terms, the amplitude of each of which is uncertain."""
    each = {**TERM, "amplitude": [one / terms for one in TERM["amplitude"]]}
    ends = [end / terms for end in AMPLITUDES["between"]]
    split = {f"disturbance.terms.{k}.amplitude": {"between": ends} for k in range(terms)}
    if name == PRINTED:
        return load(name, {"uncertainty": sets, "simulation.t1": 8.0, **more})
    changes = {"disturbance.terms": [each] * terms, "uncertainty": {**split, **sets}, "simulation.t1": 3.0}
    return load(name, {**changes, "scheme.sampled_data.adaptation": None, **more})


def near(one: Any, other: Any, within: float) -> bool:
    """Whether two answers of a certificate are the same, but for rounding of their numbers."""
    if isinstance(one, dict):
        return one.keys() == other.keys() and all(near(one[key], other[key], within) for key in one)
    if isinstance(one, list):
        return len(one) == len(other) and all(near(a, b, within) for a, b in zip(one, other, strict=True))
    if isinstance(one, float) and isinstance(other, float):
        return bool(np.isclose(one, other, rtol=within, atol=1e-12))
    return bool(one == other)


def numbers(verdict: Verdict) -> dict[str, Any]:
    """Its answer without its texts, which name the numbers of the set."""
    said = verdict.as_json()
    statuses = sorted(one["status"] for one in said["assumptions"])
    return {**{key: said[key] for key in ("holds", "grade", "margin", "bound", "since")}, "statuses": statuses}


@st.composite
def permuted(draw: st.DrawFn, sets: dict[str, Any]) -> dict[str, Any]:
    """A set in another order, with values that are none among it."""
    padding = draw(st.lists(st.sampled_from(sorted(NOTHING)), unique=True))
    items = draw(st.permutations([*sets.items(), *((path, NOTHING[path]) for path in padding)]))
    return dict(items)


@once
@given(permuted(SET))
def test_order_and_padding_change_no_bit_of_a_quick_certificate(sets: dict[str, Any]) -> None:
    plain, other = written(SET), written(dict(reversed(sets.items())))
    for certificate in QUICK:
        assert certificate(plain).as_json() == certificate(other).as_json(), certificate.name


@once
@given(st.integers(2, 3))
def test_equal_terms_add_up_in_a_quick_certificate(terms: int) -> None:
    plain, other = written(SET), written(SET, terms)
    for certificate in QUICK:
        assert near(numbers(certificate(plain)), numbers(certificate(other)), 1e-6), certificate.name


@pytest.mark.full
@some
@given(permuted(SET))
def test_order_and_padding_change_no_bit_of_any_certificate(sets: dict[str, Any]) -> None:
    plain, other = written(SET), written(sets)
    for certificate in (*CERTIFICATES, lambda one: statistical(one, 40)):
        assert certificate(plain).as_json() == certificate(other).as_json()
    heavy = {path: one for path, one in SET.items() if path.startswith("robot.plant.masses")}
    plain, other = (written(one, name=PRINTED) for one in (heavy, {**NOTHING_PRINTED, **heavy}))
    for certificate in CERTIFICATES:
        assert certificate(plain).as_json() == certificate(other).as_json(), certificate.name


NOTHING_PRINTED = {"start.q": {"around": 0.0, "each": "joint"}, "disturbance.scale": {"around": 0.0}}


@pytest.mark.full
@settings(some, max_examples=2)
@given(st.integers(2, 8), st.booleans())
def test_equal_terms_and_terms_of_nothing_change_no_certificate(terms: int, learns: bool) -> None:
    more = {"scheme.sampled_data.adaptation": {"kind": "joint_learning"}} if learns else {}
    plain, other = written(SET, **more), written(SET, terms, **more)
    nothing = [{**TERM, "amplitude": [0.0, 0.0]}, {"kind": "step", "value": [0.0, 0.0], "start": 1.0, "end": 1.1}]
    silent = {f"disturbance.terms.{k + 1}.{name}": {"around": 0.0} for k, name in enumerate(("amplitude", "value"))}
    padded = written({**silent, **SET}, **more, **{"disturbance.terms": [TERM, *nothing]})
    for certificate in CERTIFICATES:
        asked = numbers(certificate(plain))
        assert near(asked, numbers(certificate(other)), 1e-4), certificate.name
        assert near(asked, numbers(certificate(padded)), 1e-4), certificate.name


@pytest.mark.full
@pytest.mark.parametrize("learns", [False, True])
def test_a_larger_set_has_no_smaller_bounds(learns: bool) -> None:
    more = {"scheme.sampled_data.adaptation": {"kind": "joint_learning"}} if learns else {}
    sizes = []
    for part in (0.25, 0.5, 1.0):
        sets = {
            "robot.plant.masses": {"around": f"{6 * part} %", "each": "joint"},
            "start.q": {"around": 0.02 * part, "each": "joint"},
            "disturbance.terms.0.amplitude": {"around": 0.4 * part, "each": "joint"},
        }
        scenario = written(sets, **more)
        verdicts = {one.name: one(scenario).bound for one in CERTIFICATES}
        sizes.append(
            {
                "start": verdicts["admissibility"]["start_error"],
                "radius": verdicts["inertia_ratio"]["radius"],
                "needed": [verdicts["robust_torque"]["needed"]],
                "torque": verdicts["torque_budget"]["torque"],
                "step": verdicts["torque_budget"]["torque_step"],
                "error": verdicts["loop_rate"]["error_bound"],
            }
        )
    for small, large in pairwise(sizes):
        for name in small:
            # The bound of a law that learns is that of simulated arms, of which some are others in a larger set.
            spare = 0.98 if name == "error" and learns else 1.0 - 1e-9
            assert (np.asarray(large[name]) >= spare * np.asarray(small[name])).all(), name


def test_more_numbers_than_a_product_can_be_bounded_for_are_sampled() -> None:
    (robust_torque,) = (certificate for certificate in CERTIFICATES if certificate.name == "robust_torque")
    lines = [line for line in robust_torque(written(SET, 12)).assumptions if "disturbance.terms.0" in line.text]
    assert [line.status for line in lines] == ["tested"]
