"""Many cases in a compiled loop: each equals, bit for bit, the single run of its scenario."""

from typing import Any

import numpy as np
import pytest

from slidax.core.errors import DefinitionError
from slidax.scenarios.family import Family
from slidax.scenarios.load import alter_description, read_description
from slidax.studies.cases import Cases, columns_of, points
from tests.studies.files import UNCERTAIN

SHORT = {"simulation.t1": 0.1}


def cases(scenario: str, sets: dict[str, Any], changes: dict[str, Any], engine: str | None = None) -> Cases:
    base = alter_description(read_description(scenario), {**changes, "uncertainty": sets})
    return Cases(Family.of(base), engine)


def drawn(of: Cases, rows: int, seed: int = 0) -> dict[str, Any]:
    return of.family.space.values(points(seed, 0, rows, of.family.space.dimensions))


def alone(of: Cases, values: dict[str, Any], row: int) -> dict[str, Any]:
    item = of.family.scenario({path: array[row] for path, array in values.items()}, "alone")
    return columns_of(item.simulate(log_every=None))


def same(many: dict[str, Any], row: int, row_alone: dict[str, Any], rtol: float = 0.0) -> bool:
    return all(
        np.allclose(many[name][row], row_alone[name][0], rtol=rtol, atol=rtol, equal_nan=True) for name in row_alone
    )


MORE = {
    **UNCERTAIN,
    "disturbance.terms.0.amplitude": {"around": "20 %", "each": "joint"},
    "sensor.delay": {"choice": [1, 2]},
    "sensor.resolution": {"between": [1e-6, 1e-4], "distribution": "log_uniform"},
    "sensor.seed": {"choice": "any"},
    "actuator.time_constant": {"between": [0, 0.002]},
}


def test_each_case_of_a_study_equals_its_single_run_bit_for_bit():
    of = cases("example-4.1-1khz", MORE, {**SHORT, "sensor.position_noise": 1e-6})
    values = drawn(of, 40)
    table = of.run(values)
    for row in (0, 17, 39):
        assert same(table, row, alone(of, values, row))
    # Noise, delay and the other values differ between the cases.
    assert len(np.unique(table["rms_error"])) == 40


def test_the_results_of_a_case_do_not_depend_on_the_other_cases():
    of = cases("example-4.1-1khz", UNCERTAIN, SHORT)
    values = drawn(of, 20)
    whole = of.run(values)
    part = of.run({path: array[7:10] for path, array in values.items()})
    for name, column in whole.items():
        assert np.array_equal(column[7:10], part[name], equal_nan=True)


@pytest.mark.full
@pytest.mark.parametrize("scenario", ["panda-payload", "ur5e-payload"])
def test_a_case_with_every_uncertain_quantity_of_an_arm_equals_its_single_run(scenario):
    sets = {
        "robot.plant.mass_factor": {"around": "20 %", "each": "joint"},
        "robot.plant.load.mass": {"between": [0.1, 2]},
        "robot.plant.load.center": {"ball": 0.05},
        "robot.plant.coulomb": {"between": [0.1, 0.5], "each": "joint"},
        "robot.plant.armature": {"between": [0.05, 0.2], "distribution": "log_uniform", "each": "joint"},
        "start": {"inside": "envelope", "share": 0.2},
    }
    of = cases(scenario, sets, SHORT)
    values = drawn(of, 9)
    table = of.run(values)
    assert same(table, 8, alone(of, values, 8))


# XLA compiles this for long; `tests/simulation/test_batches.py` has smaller batches of both engines.
@pytest.mark.full
def test_both_engines_give_the_same_metrics_of_cases_up_to_rounding():
    changes = {**SHORT, "simulation.t1": 0.02}
    native = cases("example-4.1-1khz", UNCERTAIN, changes)
    values = drawn(native, 5)
    xla = cases("example-4.1-1khz", UNCERTAIN, changes, engine="xla").run(values)
    table = native.run(values)
    for row in range(5):
        assert same(table, row, {name: xla[name][row : row + 1] for name in xla}, rtol=1e-7)


def test_cases_with_different_periods_equal_single_runs_and_too_many_periods_are_refused(monkeypatch):
    base = alter_description(read_description("example-4.1-1khz"), SHORT)
    sets = {"simulation.period": {"choice": [0.001, 0.002]}, "disturbance.scale": {"between": [0, 1]}}
    family = Family.of(base, {}, type(base).model_validate({**base.model_dump(), "uncertainty": sets}).uncertainty)
    of = Cases(family)
    values = drawn(of, 8)
    table = of.run(values)
    assert len(set(values["simulation.period"].tolist())) == 2
    one_of_each = [int(np.flatnonzero(values["simulation.period"] == h)[0]) for h in (0.001, 0.002)]
    for row in one_of_each:
        assert same(table, row, alone(of, values, row))
    monkeypatch.setattr("slidax.studies.cases.MOST_LOOPS", 2)
    with pytest.raises(DefinitionError, match=r"`simulation\.period` needs a loop of its own, and at most 2"):
        of.run({**values, "simulation.period": np.repeat([0.001, 0.002, 0.004, 0.005], 2)})


def test_points_can_be_drawn_individually_and_fill_the_cube():
    whole = points(3, 0, 1000, 5)
    assert np.array_equal(points(3, 617, 4, 5), whole[617:621])
    assert not np.array_equal(points(4, 0, 1000, 5), whole) and np.abs(whole.mean(axis=0) - 0.5).max() < 0.04
    assert np.abs(np.corrcoef(whole.T) - np.eye(5)).max() < 0.12
