"""Maps: each point is the run with these values, and what the law is told makes a difference."""

import numpy as np
import pytest

from slidax import scenarios
from slidax.core.errors import DefinitionError
from slidax.studies.cases import columns_of
from slidax.studies.sweep import one_number

from .kinds import SHORT, found

pytest.importorskip("llvmlite")


@pytest.fixture(scope="module")
def swept():
    over = {
        "scheme.performance.final": {"between": [5e-4, 2e-3], "distribution": "log_uniform"},
        "disturbance.scale": {"choice": [0.0, 1.0]},
    }
    return found("sweep", over=over, points=3, of="peak_torque", uncertainty={})


def test_each_point_of_the_map_is_the_run_with_its_values(swept):
    assert swept.worst.shape == swept.shape == (3, 2)
    finals, scales = map(one_number, swept.axes.values())
    np.testing.assert_allclose(finals, [5e-4, 1e-3, 2e-3], rtol=1e-12)
    assert scales.tolist() == [0.0, 1.0]
    for i, j in ((0, 1), (2, 0)):
        values = {"scheme.performance.final": float(finals[i]), "disturbance.scale": float(scales[j])}
        item = scenarios.load("example-4.1-1khz", SHORT | values).simulate(log_every=None, progress=False)
        assert columns_of(item)["peak_torque"][0] == swept.worst[i, j]


def test_its_page_has_the_map_and_its_points(swept):
    (section,) = swept.sections()
    assert [picture.name for picture in section.figures] == ["map"]
    assert len(section.rows) == 6 and section.rows[1][-2] == swept.worst[0, 1]
    assert swept.as_json()["map"][2][1] == swept.worst[2, 1]
    assert swept.lead.startswith("3 x 2 points, 6 runs: no run fails at 6 of 6")


@pytest.mark.full
def test_a_period_is_swept_though_each_value_is_another_loop():
    periods = found("sweep", over={"simulation.period": {"choice": [1e-3, 2e-3]}}, of="steady_error", uncertainty={})
    assert periods.worst[0] != periods.worst[1] and np.isfinite(periods.worst).all()


@pytest.mark.full
def test_a_point_has_the_same_cases_as_any_other():
    over = {"robot.plant.inertias": {"between": [4.5, 5.5]}}
    maps = found("sweep", over=over, points=2, cases=4, law="not told")
    starts = maps.table["start.q[0]"].reshape(2, 4)
    np.testing.assert_array_equal(starts[0], starts[1])
    assert len(set(starts[0])) == 4
    np.testing.assert_array_equal(maps.table["robot.plant.inertias[0]"], np.repeat([4.5, 5.5], 4))
    assert maps.worst.tolist() == maps.table["margin"].reshape(2, 4).min(axis=1).tolist()


@pytest.mark.parametrize(
    ("said", "message"),
    [
        ({"over": {}}, "over"),
        ({"over": {"scheme.surface.k9": {"between": [0, 1]}}}, "k9"),
        ({"over": {"robot.plant.masses": {"around": "5 %", "each": "joint"}}}, "sweep a single value for all joints"),
        ({"over": {"disturbance.scale": {"between": [0, 1]}}, "of": "marginn"}, "did you mean `margin`"),
        ({"over": {"disturbance.scale": {"between": [0, 1]}}, "points": 1}, "points"),
        (
            {"over": {"disturbance.scale": {"between": [0, 1]}}, "uncertainty": {}, "cases": 5},
            "cases: needs a scenario",
        ),
    ],
)
def test_what_cannot_be_swept_is_said_in_a_line(said, message):
    with pytest.raises(DefinitionError) as error:
        found("sweep", **{"points": 2, **said})
    assert message in str(error.value) and "\n" not in str(error.value)
