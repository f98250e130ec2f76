import numpy as np
import pytest
from matplotlib.figure import Figure

from slidax import scenarios


@pytest.fixture(scope="module")
def scenario():
    return scenarios.load("example-4.1-1khz", {"simulation.t1": 0.3})


@pytest.mark.parametrize(("name", "unit"), [("errors", "rad"), ("velocity_errors", "rad/s"), ("torques", "N m")])
def test_a_plot_draws_all_joints_into_the_callers_axes(scenario, name, unit):
    run = scenario.simulate(progress=False)
    axes = Figure().subplots()
    assert getattr(run.plot, name)(ax=axes) is axes
    drawn = {"errors": run.log.e, "velocity_errors": run.log.de, "torques": run.log.tau}[name]
    assert [line.get_label() for line in axes.lines] == ["joint 1", "joint 2"]
    np.testing.assert_array_equal(axes.lines[1].get_ydata(), np.asarray(drawn)[:, 1])
    assert axes.get_ylabel().endswith(f"[{unit}]")


def test_a_plot_without_axes_creates_a_figure(scenario):
    run = scenario.simulate(progress=False)
    assert all(isinstance(plot(), Figure) for plot in (run.plot.errors, run.plot.torques, run.plot.envelope))
    axes = Figure().subplots()
    run.plot.envelope(ax=axes)
    assert len(axes.lines) == 3


def test_a_scenario_writes_the_report_of_its_run(scenario, tmp_path):
    page = scenario.report(scenario.simulate(progress=False), tmp_path)
    assert "Inside the envelope" in page.read_text(encoding="utf-8")
