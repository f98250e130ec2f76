"""Printed overview of a run: its outcome and main metrics, no arrays."""

import re
import sys
from types import ModuleType
from xml.etree import ElementTree

import jax
import numpy as np
import pytest

from slidax import analysis
from slidax.core.errors import DefinitionError
from slidax.simulation import simulate, simulate_batch
from tests.paper_examples import MOTION_4_1, MOTION_4_2, START_4_1, START_4_2, law_4_2, plant_4_2
from tests.simulation.simple import SMOOTH_PLANT, SPRING
from tests.simulation.test_batches import HOW, RADII, falling


@pytest.fixture(scope="module")
def scara():
    return simulate(plant_4_2(), law_4_2(), MOTION_4_2, START_4_2, t1=0.4, period=1e-3, outside="recover")


def test_a_run_prints_its_outcome_and_each_joints_metrics_with_units(scara):
    lines = repr(scara).splitlines()
    assert lines[0].startswith("Run of 3 joints to 0.4 s, sampled every 0.001 s: ")
    assert len(lines) < 10
    assert max(map(len, lines[:5])) < 110
    for joint, (name, unit) in enumerate(zip(scara.joint_names, scara.joint_units, strict=True)):
        (line,) = [line for line in lines if line.startswith(name)]
        assert f"{analysis.steady_error(scara)[joint]:.4g} {unit}" in line
        torque_unit = "N m" if unit == "rad" else "N"
        assert re.search(rf" {analysis.peak_torque(scara)[joint]:.4g} {torque_unit}( |$)", line)
        assert f"{analysis.steady_torque_step(scara)[joint]:.4g} {torque_unit}" in line
        assert f"{analysis.envelope_margin(scara)[joint]:.4g} of its width" in line


def test_a_run_that_ended_early_prints_its_reason_and_a_dash_for_a_missing_metric():
    run = simulate(*falling(RADII[0]), **HOW)
    text = str(run)
    assert "left_envelope" in text and run.outcome.message in text
    assert "nan" not in text and "inf" not in text
    assert re.search(r"joint 1 +- +- ", text)


def test_the_printed_settling_time_uses_a_band_of_the_metrics():
    run = simulate(SMOOTH_PLANT, SPRING, MOTION_4_1, START_4_1, t1=0.5, period=0.01, bands=(10.0, 1e-3))
    assert "settled to 0.001" in repr(run)
    never = repr(run).splitlines()[2].split("  ")
    assert never[0] == "joint 1" and "-" in [cell.strip() for cell in never]
    other = simulate(SMOOTH_PLANT, SPRING, MOTION_4_1, START_4_1, t1=0.5, period=0.01, bands=(10.0,))
    assert "settled" not in repr(other)


def test_a_batch_prints_its_outcomes_and_the_worst_run():
    runs = simulate_batch(falling, RADII, **HOW)
    text = repr(runs)
    assert text.startswith("3 runs of 2 joints to 0.4 s, sampled every 0.04 s: 2 left_envelope, 1 ok")
    assert runs.outcomes[0].message in text
    assert "\nworst" in text


def test_a_run_inside_a_jax_transformation_prints_as_a_pytree():
    printed = []
    jax.jit(lambda run: printed.append(repr(run)))(simulate(*falling(RADII[1]), **HOW))
    assert printed[0].startswith("Run(")


def test_a_notebook_shows_a_run_as_a_table_and_an_error_plot(scara):
    page = ElementTree.fromstring(f"<div>{scara._repr_html_().replace('<br>', '<br/>')}</div>")
    assert [row[0].text for row in page.iter("tr")][1:] == list(scara.joint_names)
    (picture,) = page.iter("{http://www.w3.org/2000/svg}svg")
    errors = list(picture.iter("{http://www.w3.org/2000/svg}polyline"))
    assert len(errors) == 3
    # The curve of the first joint: from pixels back to its error.
    points = np.array([[float(x) for x in point.split(",")] for point in errors[0].get("points").split()])
    size = max(np.abs(scara.log.e[:, 0]).max(), np.abs(scara.log.envelope.lower[:, 0]).max())
    size = max(size, np.abs(scara.log.envelope.upper[:, 0]).max())
    np.testing.assert_allclose((1 - points[:, 1] / 35) * size, scara.log.e[:, 0], atol=0.002 * size)
    assert "<svg" not in simulate(*falling(RADII[1]), **HOW | {"log_every": None})._repr_html_()


def test_the_log_is_a_data_frame_with_names_and_units(scara, monkeypatch):
    class DataFrame(dict):
        def __init__(self, columns):
            super().__init__(columns)
            self.attrs = {}

    pandas = ModuleType("pandas")
    pandas.DataFrame = DataFrame
    monkeypatch.setitem(sys.modules, "pandas", pandas)
    frame = scara.frame()
    for joint, name in enumerate(scara.joint_names):
        np.testing.assert_array_equal(frame[f"e[{name}]"], scara.log.e[:, joint])
        np.testing.assert_array_equal(frame[f"tau[{name}]"], scara.log.tau[:, joint])
    units = frame.attrs["units"]
    assert set(units) == set(frame)
    assert units["t"] == "s" and units["k"] == ""
    rates = [units[f"ddq_d[{name}]"] for name in scara.joint_names]
    assert rates == [f"{unit}/s²" for unit in scara.joint_units]
    assert [units[f"tau[{name}]"] for name in scara.joint_names] == ["N m", "N m", "N"]
    with pytest.raises(DefinitionError, match="a batch of 3 runs has no single log"):
        simulate_batch(falling, RADII, **HOW).frame()


def test_a_missing_pandas_is_reported_with_the_install_command(scara, monkeypatch):
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(DefinitionError, match=r"pip install 'slidax\[frame\]'"):
        scara.frame()
