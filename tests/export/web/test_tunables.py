from functools import cache

import numpy as np
import pytest

from slidax.core.errors import DefinitionError, DefinitionWarning
from slidax.export.web.playground import ARMS
from slidax.export.web.tunables import ORDER, tunables_of
from slidax.scenarios.load import validate_text

SCENARIOS = {shown.arm: shown for shown in ARMS}


@cache
def described(arm):
    result = SCENARIOS[arm].description
    return result.model_copy(update={"robot": result.robot.resolved()})


@cache
def tunables(arm):
    return tuple(tunables_of(described(arm), len(described(arm).start.q)))


EVERY_ARM = pytest.mark.parametrize("arm", SCENARIOS)


def refused(arm, some):
    data = described(arm).model_dump(exclude_unset=True)
    result = {}
    for tunable in some:
        for value in (tunable.low, tunable.high):
            try:
                validate_text(
                    data, {tunable.path: np.full(() if tunable.each else tunable.shape, value).tolist()}
                ).build("end")
            except (DefinitionError, DefinitionWarning) as error:
                # A scenario with a useless bound runs, and its warning is left to the visitor.
                if isinstance(error, DefinitionWarning) and "scheme.bound" in str(error):
                    continue
                result[tunable.path, value] = str(error)
    return result


@pytest.mark.full
@EVERY_ARM
def test_both_ends_of_each_slider_are_valid_in_a_scenario(arm):
    # Without a velocity sensor its noise has no slider.
    some = [tunable for tunable in tunables(arm) if tunable.path != "sensor.velocity_noise"]
    assert refused(arm, some) == {}


@EVERY_ARM
def test_a_slider_contains_its_default_and_stays_in_the_declared_range(arm):
    for tunable in tunables(arm):
        lower, upper = tunable.leaf.ends
        own = np.ravel(tunable.defaults)
        assert lower <= tunable.low < tunable.high <= upper, tunable.path
        assert (tunable.low <= own).all() and (own <= tunable.high).all(), tunable.path
        assert not tunable.logarithmic or tunable.low > 0, tunable.path


def test_important_parameters_have_sliders_with_units():
    result = {tunable.path: tunable for tunable in tunables("panda")}
    wanted = {
        "scheme.transformation.performance.deadline": ("s", "Envelope"),
        "scheme.surface.k1": ("rad/s or m/s", "Law"),
        "robot.plant.load.mass": ("kg", "True arm"),
        "robot.plant.armature": ("kg m² or kg", "True arm"),
        "actuator.time_constant": ("s", "Drives"),
    }
    for path, (unit, group) in wanted.items():
        assert path in result, (path, sorted(result))
        assert result[path].group == group and result[path].leaf.unit == unit


@EVERY_ARM
def test_noise_seeds_and_values_of_another_arm_have_no_sliders(arm):
    for tunable in tunables(arm):
        assert not {*tunable.path.split(".")} & {"seed", "lengths", "gravity_acceleration", "phase", "attached"}
        assert not tunable.path.startswith(("robot.nominal", "simulation", "start", "trajectory", "uncertainty"))


@EVERY_ARM
def test_sliders_have_titles_and_are_sorted_by_group(arm):
    assert all(tunable.title and "[" not in tunable.title for tunable in tunables(arm))
    groups = [ORDER.index(tunable.group) for tunable in tunables(arm)]
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
def test_slider_range_follows_from_declared_range_and_default(changes, path, low, high, logarithmic):
    result = validate_text(described("two_link").model_dump(exclude_unset=True), changes)
    tunable = next(item for item in tunables_of(result, 2) if item.path == path)
    assert (tunable.low, tunable.high, tunable.logarithmic) == (pytest.approx(low), pytest.approx(high), logarithmic)


def test_a_slider_has_the_positions_of_its_values_in_the_input_vector():
    tunable = next(item for item in tunables("panda") if item.each)
    entry = tunable.entry(5)
    assert entry["inputs"] == [5, 7] and entry["each"]
    assert np.broadcast_to(entry["default"], 7).tolist() == tunable.defaults.tolist()
