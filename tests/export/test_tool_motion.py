"""A path of the tool in C: the joints' motion is a table there, and the loop leads the tool along the path."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from slidax.analysis import tool_error
from slidax.export import export_c
from slidax.report import tip_paths
from slidax.scenarios import load

from .exported import COMPILERS, compiled, needs_a_compiler, run

pytestmark = [needs_a_compiler, pytest.mark.full]

PATH = """
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
    long k;
    slidax_law_parameters_default(&parameters);
    slidax_law_reset(&state);
    slidax_law_start(&plant);
    slidax_law_measure(&plant, &arm);
    for (k = 0; k <= 3000; ++k) {
        int i;
        arm.t = (double)k * 1e-3;
        slidax_law_motion(arm.t, 1e-3, &reference);
        if (slidax_law_step(&arm, &reference, &state, &parameters, &command) != 0) {
            return 1;
        }
        printf("%a %a %a %a\\n", arm.q[0], arm.q[1], reference.q[0], reference.q[1]);
        slidax_law_arm(arm.t, arm.q, arm.dq, command.tau, ddq);
        for (i = 0; i < 2; ++i) {
            arm.dq[i] += 1e-3 * ddq[i];
            arm.q[i] += 1e-3 * arm.dq[i];
        }
    }
    return 0;
}
"""


def test_the_loop_in_c_leads_the_tool_as_that_of_python_does(tmp_path: Path) -> None:
    file = tmp_path / "path.yaml"
    file.write_text(PATH, encoding="utf-8")
    scenario = load(file)
    export_c(scenario, tmp_path, name="law")
    (tmp_path / "loop.c").write_text(LOOP)
    compiled(COMPILERS[0], tmp_path, "-O2", "slidax_law.c", "slidax_law_scenario.c", "loop.c", "-o", "loop", "-lm")
    rows = np.array([[float.fromhex(x) for x in line.split()] for line in run(tmp_path, "./loop").splitlines()])
    ours = scenario.simulate(log_every=1)
    np.testing.assert_allclose(rows[:, 2:], ours.log.reference.q, rtol=0, atol=1e-12)
    np.testing.assert_allclose(rows[:, :2], ours.log.state.q, rtol=0, atol=1e-9)
    actual, desired = tip_paths(scenario.plant.robot, ours)
    assert tool_error(ours) == pytest.approx(np.linalg.norm(actual - desired, axis=1).max())
    # The path itself: the line as it was asked for, and back where the circle began.
    line = desired[:601] - desired[0]
    along = line @ np.array([-0.2, 0.1, 0.0]) / 0.05
    assert np.abs(line - along[:, None] * np.array([-0.2, 0.1, 0.0])).max() < 2e-6
    np.testing.assert_allclose(desired[600], desired[0] + [-0.2, 0.1, 0.0], atol=2e-6)
    np.testing.assert_allclose(desired[-1], desired[600], atol=2e-6)
