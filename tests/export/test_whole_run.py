"""A whole run in C is the whole run in Python, as long as it does not chatter."""

from __future__ import annotations

import numpy as np

from slidax.export import export_c
from slidax.scenarios import load

from .exported import COMPILERS, compiled, needs_a_compiler, run

pytestmark = needs_a_compiler

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
    for (k = 0; k <= 100000; ++k) {
        int i;
        arm.t = (double)k * 1e-4;
        slidax_law_motion(arm.t, 1e-4, &reference);
        if (slidax_law_step(&arm, &reference, &state, &parameters, &command) != 0) {
            return 1;
        }
        if (k % 1000 == 0) {
            printf("%a %a %a %a\\n", arm.q[0], arm.q[1], command.tau[0], command.tau[1]);
        }
        slidax_law_arm(arm.t, arm.q, arm.dq, command.tau, ddq);
        for (i = 0; i < 2; ++i) {
            arm.dq[i] += 1e-4 * ddq[i];
            arm.q[i] += 1e-4 * arm.dq[i];
        }
    }
    return 0;
}
"""


def test_example_4_1_is_the_same_to_1e_9_over_its_100_000_steps(tmp_path):
    held = {"simulation.mode": "held", "simulation.integrator": "semi_implicit_euler", "simulation.log_every": 1000}
    scenario = load("example-4.1", held)
    export_c(scenario, tmp_path, name="law")
    (tmp_path / "loop.c").write_text(LOOP)
    compiled(COMPILERS[0], tmp_path, "-O2", "slidax_law.c", "slidax_law_scenario.c", "loop.c", "-o", "loop", "-lm")
    rows = np.array([[float.fromhex(x) for x in line.split()] for line in run(tmp_path, "./loop").splitlines()])
    log = scenario.simulate().log
    assert len(rows) == len(log.t) == 101
    np.testing.assert_allclose(rows[:, :2], log.state.q, rtol=0, atol=1e-9)
    np.testing.assert_allclose(rows[:, 2:], log.tau, rtol=0, atol=1e-6)
