import numpy as np
import pytest

from slidax.export import export_c
from slidax.report import tip_paths
from slidax.scenarios import load

from .exported import COMPILERS, compiled, needs_a_compiler, run

pytestmark = [needs_a_compiler, pytest.mark.full]

HELD = {"simulation.mode": "held", "simulation.integrator": "semi_implicit_euler"}

TOOL_PATH = """
title: a line and a circle of the tool
robot:
  kind: two_link
  plant: {lengths: [1.0, 0.8], masses: [0.5, 1.5], inertias: [5.0, 5.0], gravity_acceleration: 9.8}
trajectory:
  kind: tool_path
  hold: place
  start: [0.4, 1.2]
  moves:
    - {kind: line, by: [-0.2, 0.1, 0.0], duration: 0.6}
    - {kind: circle, center: [0.75, 1.29, 0], axis: [0, 0, 1], duration: 2}
start: {q: [0.4, 1.2], dq: [0.0, 0.0]}
scheme: {name: computed_torque, kp: 400.0, kd: 40.0}
disturbance: {scale: 1.0, terms: [{kind: harmonic, amplitude: [2.0, 1.0], frequency: 3.0}]}
simulation: {mode: held, integrator: semi_implicit_euler, period: 1.0e-3, substeps: 1, t1: 3.0}
"""

LOOP = """
#include "slidax_law_scenario.h"
#include <stdio.h>

int main(void)
{
    slidax_law_parameters parameters;
    slidax_law_reference reference;
    slidax_law_state state;
    slidax_law_command command;
    slidax_law_plant plant;
    slidax_law_measurement arm;
    double ddq[2];
    slidax_law_parameters_default(&parameters);
    slidax_law_reset(&state);
    slidax_law_start(&plant);
    slidax_law_measure(&plant, &arm);
    for (long k = 0; k <= STEPS; ++k) {
        arm.t = (double)k * PERIOD;
        slidax_law_motion(arm.t, PERIOD, &reference);
        if (slidax_law_step(&arm, &reference, &state, &parameters, &command) != 0) return 1;
        if (k % EVERY == 0) {
            for (int i = 0; i < 2; ++i) printf("%a %a %a ", arm.q[i], reference.q[i], command.tau[i]);
            printf("\\n");
        }
        slidax_law_arm(arm.t, arm.q, arm.dq, command.tau, ddq);
        for (int i = 0; i < 2; ++i) {
            arm.dq[i] += PERIOD * ddq[i];
            arm.q[i] += PERIOD * arm.dq[i];
        }
    }
    return 0;
}
"""


def run_in_c(scenario, folder, every):
    """Logged q, q_d and tau of a run in C, [3, rows, 2]."""
    export_c(scenario, folder, name="law")
    (folder / "loop.c").write_text(LOOP)
    sizes = f"-DSTEPS={round(scenario.t1 / scenario.period)} -DPERIOD={scenario.period!r} -DEVERY={every}".split()
    files = ("slidax_law.c", "slidax_law_scenario.c", "loop.c")
    compiled(COMPILERS[0], folder, "-O2", *sizes, *files, "-o", "loop", "-lm")
    rows = [[float.fromhex(x) for x in line.split()] for line in run(folder, "./loop").splitlines()]
    return np.array(rows).reshape(-1, 2, 3).swapaxes(1, 2).swapaxes(0, 1)


def test_run_of_example_4_1_in_c_agrees_with_python_to_1e_9_over_100_000_steps(tmp_path):
    scenario = load("example-4.1", HELD | {"simulation.log_every": 1000})
    q, _, tau = run_in_c(scenario, tmp_path, 1000)
    log = scenario.simulate().log
    assert len(q) == len(log.t) == 101
    np.testing.assert_allclose(q, log.state.q, rtol=0, atol=1e-9)
    np.testing.assert_allclose(tau, log.tau, rtol=0, atol=1e-6)


def test_the_loop_in_c_moves_the_tool_along_the_path_as_in_python(tmp_path):
    file = tmp_path / "path.yaml"
    file.write_text(TOOL_PATH, encoding="utf-8")
    scenario = load(file)
    q, q_d, _ = run_in_c(scenario, tmp_path, 1)
    ours = scenario.simulate(log_every=1)
    np.testing.assert_allclose(q_d, ours.log.reference.q, rtol=0, atol=1e-12)
    np.testing.assert_allclose(q, ours.log.state.q, rtol=0, atol=1e-9)
    _, desired = tip_paths(scenario.plant.robot, ours)
    # The path: the commanded line, then a full circle back to its start.
    line = desired[:601] - desired[0]
    along = line @ np.array([-0.2, 0.1, 0.0]) / 0.05
    assert np.abs(line - along[:, None] * np.array([-0.2, 0.1, 0.0])).max() < 2e-6
    np.testing.assert_allclose(desired[600], desired[0] + [-0.2, 0.1, 0.0], atol=2e-6)
    np.testing.assert_allclose(desired[-1], desired[600], atol=2e-6)
