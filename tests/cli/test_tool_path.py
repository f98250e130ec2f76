import json

import jax.numpy as jnp
import numpy as np
import pytest

import slidax as sx
from slidax.analysis import rms_tool_error, rms_tool_turn, steady_tool_error, steady_tool_turn, tool_error, tool_turn
from slidax.core.types import State

from .commands import in_process

LINE = """
title: a line of the tool
robot:
  kind: two_link
  plant: {lengths: [1.0, 0.8], masses: [0.5, 1.5], inertias: [5.0, 5.0], gravity_acceleration: 9.8}
trajectory:
  kind: tool_path
  hold: place
  start: [0.4, 1.2]
  moves: [{kind: line, by: [-0.2, 0.1, 0.0], duration: 0.6}]
start: {q: [0.4, 1.2], dq: [0.0, 0.0]}
scheme: {name: computed_torque, kp: 400.0, kd: 40.0}
disturbance: {scale: 1.0, terms: [{kind: harmonic, amplitude: [2.0, 1.0], frequency: 3.0}]}
simulation: {mode: held, period: 1.0e-3, substeps: 2, t1: 1.0}
"""


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "line.yaml"
    path.write_text(LINE, encoding="utf-8")
    return path


def test_the_tool_error_is_computed_from_all_samples(file):
    scenario = sx.scenarios.load(file)
    run = scenario.simulate(log_every=1)
    actual, desired = sx.report.tip_paths(scenario.plant.robot, run)
    away = np.linalg.norm(actual - desired, axis=1)
    assert away.max() > 1e-6
    late = np.asarray(run.log.t) >= 0.75 * scenario.t1 - 1e-9
    assert tool_error(run) == pytest.approx(away.max(), rel=1e-12)
    assert steady_tool_error(run) == pytest.approx(away[late].max(), rel=1e-12)
    assert rms_tool_error(run) == pytest.approx(np.sqrt(np.mean(away**2)), rel=1e-12)
    # In a plane the tool is turned by the sum of both joints.
    turned = np.abs(np.sum(np.asarray(run.log.e), axis=1))
    assert turned.max() > 1e-6 and tool_turn(run) == pytest.approx(turned.max(), rel=1e-9)
    assert steady_tool_turn(run) == pytest.approx(turned[late].max(), rel=1e-9)
    assert rms_tool_turn(run) == pytest.approx(np.sqrt(np.mean(turned**2)), rel=1e-9)
    thinned = scenario.simulate(log_every=None)
    assert tool_error(thinned) == tool_error(run) and tool_turn(thinned) == tool_turn(run)


def test_run_without_a_tool_path_has_no_tool_error():
    run = sx.scenarios.load("example-4.1-1khz", {"simulation.t1": 0.01}).simulate(log_every=None)
    assert run.tally.tool is None and tool_error(run) is None and tool_turn(run) is None
    assert "tool_error" not in sx.analysis.summary(run)


@pytest.mark.full
@pytest.mark.parametrize("engine", ["native", "xla"])
def test_each_run_of_a_batch_has_its_own_tool_error(file, engine):
    scenario = sx.scenarios.load(file, {"simulation.t1": 0.2, "simulation.engine": engine})
    starts = np.array([[0.4, 1.2], [0.42, 1.19], [0.38, 1.25]])

    def begun(item, q):
        return item.replace(state0=State(q=q, dq=jnp.zeros(2)))

    many = scenario.simulate_batch(begun, starts)
    result = [tool_error(begun(scenario, jnp.asarray(q)).simulate()) for q in starts]
    assert len(set(result)) == 3
    np.testing.assert_allclose(np.asarray(tool_error(many)), result, rtol=1e-9)


@pytest.mark.full
def test_table_json_and_report_show_the_tool_error(file, tmp_path):
    done = in_process("run", str(file), "--json", "--out", str(tmp_path / "report"), code=0)
    metrics = json.loads(done.stdout)["metrics"]
    error, turn = metrics["tool_error"], metrics["tool_turn"]
    assert error > 0 and turn > 0
    page = (tmp_path / "report" / "report.html").read_text(encoding="utf-8")
    sentence = f"The tool is at most {error:.2g} m and {turn:.2g} rad off its path."
    assert sentence in page.replace("\xa0", " ")
    shown = in_process("run", str(file))
    assert sentence in " ".join(shown.stdout.split())
