"""The sliders of a page: from which numbers they are made, and how far they reach."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest

from slidax._errors import DefinitionError, DefinitionWarning
from slidax.deploy.web.built_in import ARMS
from slidax.deploy.web.knob import NEVER, ORDER, Knob, knobs_of
from slidax.scenarios import ScenarioDescription
from slidax.scenarios.load import validated

SCENARIOS = {shown.arm: shown for shown in ARMS}


@cache
def described(arm: str) -> ScenarioDescription:
    found = SCENARIOS[arm].description
    return found.model_copy(update={"robot": found.robot.resolved()})


@cache
def knobs(arm: str) -> tuple[Knob, ...]:
    return tuple(knobs_of(described(arm), len(described(arm).start.q)))


EVERY_ARM = pytest.mark.parametrize("arm", SCENARIOS)


def refused(arm: str, some: list[Knob]) -> dict[tuple[str, float], str]:
    data = described(arm).model_dump(exclude_unset=True)
    found = {}
    for knob in some:
        for value in (knob.low, knob.high):
            try:
                validated(data, {knob.path: np.full(() if knob.each else knob.shape, value).tolist()}).build("end")
            except (DefinitionError, DefinitionWarning) as error:
                # A bound that is of no use is the visitor's to see; it runs.
                if isinstance(error, DefinitionWarning) and "scheme.bound" in str(error):
                    continue
                found[knob.path, value] = str(error)
    return found


@pytest.mark.full
@EVERY_ARM
def test_each_end_of_each_slider_is_a_value_that_a_scenario_takes(arm: str) -> None:
    # The noise of a velocity sensor is no slider where there is none: no loop varies it.
    some = [knob for knob in knobs(arm) if knob.path != "sensor.velocity_noise"]
    assert refused(arm, some) == {}


def test_sliders_stay_above_and_below_the_other_numbers_that_they_must() -> None:
    some = [knob for knob in knobs("two_link") if knob.path.endswith((".exponent", ".inverse_inertia_max", ".window"))]
    assert len(some) >= 3
    assert refused("two_link", some) == {}


@EVERY_ARM
def test_a_slider_has_its_default_within_its_reach_and_stays_in_the_declared_range(arm: str) -> None:
    for knob in knobs(arm):
        lower, upper = knob.leaf.ends
        own = np.ravel(knob.defaults)
        assert lower <= knob.low < knob.high <= upper, knob.path
        assert (knob.low <= own).all() and (own <= knob.high).all(), knob.path
        assert not knob.logarithmic or knob.low > 0, knob.path


def test_the_numbers_that_a_visitor_looks_for_are_there_with_their_units() -> None:
    found = {knob.path: knob for knob in knobs("panda")}
    wanted = {
        "scheme.transformation.performance.deadline": ("s", "Envelope"),
        "scheme.surface.k1": ("rad/s or m/s", "Law"),
        "robot.plant.load.mass": ("kg", "The arm as it is"),
        "robot.plant.armature": ("kg m² or kg", "The arm as it is"),
        "actuator.time_constant": ("s", "Drives"),
    }
    for path, (unit, group) in wanted.items():
        assert path in found, (path, sorted(found))
        assert found[path].group == group
        assert found[path].leaf.unit == unit


@EVERY_ARM
def test_names_of_noise_and_what_would_be_another_arm_are_no_sliders(arm: str) -> None:
    for knob in knobs(arm):
        assert not {*knob.path.split(".")} & {*NEVER}
        assert not knob.path.startswith(("robot.nominal", "simulation", "start", "trajectory", "uncertainty"))
        assert knob.group in ORDER and knob.title and "[" not in knob.title
    groups = [ORDER.index(knob.group) for knob in knobs(arm)]
    assert groups == sorted(groups)


@pytest.mark.parametrize(
    ("changes", "path", "low", "high", "logarithmic"),
    [
        ({"disturbance.scale": 0.0}, "disturbance.scale", 0.0, 3.0, False),
        ({"disturbance.scale": 1.0}, "disturbance.scale", 0.1, 10.0, True),
        ({"scheme.bound.inverse_inertia_min": 0.15}, "scheme.bound.inverse_inertia_max", 0.1515, 2.0, True),
        ({"scheme.surface.k1": 2.0}, "scheme.surface.k1", 0.2, 20.0, True),
        ({"scheme.overshoot": 0.5}, "scheme.transformation.overshoot", 0.01, 0.99, False),
    ],
)
def test_how_far_a_slider_reaches_follows_from_its_range_and_its_default(
    changes: dict[str, Any], path: str, low: float, high: float, logarithmic: bool
) -> None:
    found = validated(described("two_link").model_dump(exclude_unset=True), changes)
    knob = next(one for one in knobs_of(found, 2) if one.path == path)
    assert (knob.low, knob.high, knob.logarithmic) == (pytest.approx(low), pytest.approx(high), logarithmic)


def test_a_knob_of_a_page_says_where_its_numbers_are_among_the_inputs() -> None:
    knob = next(one for one in knobs("panda") if one.each)
    entry = knob.entry(5)
    assert entry["inputs"] == [5, 7] and entry["each"]
    assert np.broadcast_to(entry["default"], 7).tolist() == knob.defaults.tolist()
