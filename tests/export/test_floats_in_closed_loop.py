from typing import NamedTuple

import pytest

from slidax.export.c_project import project
from slidax.export.c_structures import render
from slidax.export.status import ENVELOPE_LEFT, HELD, PROMISE_VOID
from slidax.scenarios import load

from .exported import COMPILERS, compiled, needs_a_compiler, run, write_law

pytestmark = [needs_a_compiler, pytest.mark.full]

# The law computes in floats or doubles, the arm in doubles.
LOOP = """
#include "slidax_law.h"
#include "slidax_arm_scenario.h"
#include <math.h>
#include <stdio.h>
#define MOST 256
#define JOINTS for (int i = 0; i < {n}; ++i)
#define SEARCHES for (int i = 0; i < {searches}; ++i)

long turns[{searches} + 1];
static long histogram[{searches} + 1][MOST];

int main(void)
{{
    static slidax_law_parameters parameters;
    static slidax_law_reference reference;
    static slidax_law_measurement measurement;
    static slidax_law_state state;
    static slidax_law_command command;
    static slidax_arm_reference wanted;
    static slidax_arm_measurement measured;
    static slidax_arm_plant plant;
    double tau[{n}];
    double worst = 0.0;
    unsigned long bits = 0;
    slidax_law_parameters_default(&parameters);
    slidax_law_reset(&state);
    slidax_arm_start(&plant);
    for (long k = 0; k < {steps}; ++k) {{
        const double t = (double)k * {period};
        slidax_arm_motion(t, {period}, &wanted);
        slidax_arm_measure(&plant, &measured);
        measurement.t = ({real})t;
        JOINTS {{
            measurement.q[i] = ({real})measured.q[i];
            measurement.dq[i] = ({real})measured.dq[i];
            reference.q[i] = ({real})wanted.q[i];
            reference.dq[i] = ({real})wanted.dq[i];
            reference.ddq[i] = ({real})wanted.ddq[i];
            reference.q_next[i] = ({real})wanted.q_next[i];
            reference.dq_next[i] = ({real})wanted.dq_next[i];
            reference.ddq_next[i] = ({real})wanted.ddq_next[i];
            if (4 * k > 3 * {steps}) worst = fmax(worst, fabs(plant.then[0].q[i] - wanted.q[i]));
        }}
        SEARCHES turns[i] = 0;
        bits |= slidax_law_step(&measurement, &reference, &state, &parameters, &command);
        JOINTS tau[i] = (double)command.tau[i];
        SEARCHES ++histogram[i][turns[i] < MOST ? turns[i] : MOST - 1];
        slidax_arm_move(&plant, {period}, tau);
    }}
    printf("%lu %.9g\\n", bits, worst);
    SEARCHES {{
        for (long k = 0; k < MOST; ++k)
            if (histogram[i][k] > 0) printf("%ld:%ld ", k, histogram[i][k]);
        printf("\\n");
    }}
    return 0;
}}
"""


class Outcome(NamedTuple):
    status: int  # all bits of all steps
    steady: float  # largest error in the last quarter, rad or m
    turns: list[dict[int, int]]  # for each search of the law, the number of steps by number of turns


def closed_loop(scenario, folder, *, single):
    folder.mkdir(exist_ok=True)
    law = project(scenario, name="law", single=single, with_golden=False)
    arm = law if not single else project(scenario, name="law", with_golden=False)
    write_law(law, folder)
    searches = count_turns(folder / "slidax_law.c")
    for template, ending in (("header.h.j2", ".h"), ("scenario.h.j2", "_scenario.h"), ("scenario.c.j2", "_scenario.c")):
        text = render(template, {"x": arm}).replace("slidax_law", "slidax_arm").replace("SLIDAX_LAW", "SLIDAX_ARM")
        (folder / f"slidax_arm{ending}").write_text(text)
    period, steps = repr(scenario.period), round(scenario.t1 / scenario.period)
    loop = LOOP.format(n=len(law.joints), real=law.real, steps=steps, period=period, searches=searches)
    (folder / "loop.c").write_text(loop)
    files = ("slidax_law.c", "slidax_arm_scenario.c", "loop.c")
    compiled(COMPILERS[0], folder, "-O2", "-ffp-contract=off", *files, "-o", "loop", "-lm")
    first, *rest = run(folder, "./loop").splitlines()
    status, steady = first.split()
    return Outcome(
        int(status), float(steady), [dict(tuple(map(int, x.split(":"))) for x in row.split()) for row in rest]
    )


def count_turns(file):
    """Add a counter to each loop of a law that ends by itself; return the number of these loops."""
    lines, searches = [], 0
    for line in file.read_text().splitlines():
        lines.append(line)
        if line.strip() == "for (;;) {" or line.strip().startswith("while ("):
            lines.append(f"++turns[{searches}];")
            searches += 1
    text = "\n".join([*lines, ""])
    file.write_text(text.replace("#include <float.h>", "#include <float.h>\nextern long turns[];", 1))
    return searches


@pytest.mark.parametrize("name", ["example-4.1-1khz", "example-4.2-1khz", "panda-payload", "ur5e-payload"])
def test_a_law_in_single_precision_stays_inside_its_envelope(name, tmp_path):
    scenario = load(name)
    single = closed_loop(scenario, tmp_path / "floats", single=True)
    assert not single.status & (HELD | ENVELOPE_LEFT.bit | PROMISE_VOID.bit)
    double = closed_loop(scenario, tmp_path / "doubles", single=False)
    assert single.status == double.status and single.steady < 2.0 * double.steady + 1e-6
    print(f"\n{name}\n  doubles {double.steady:.3g} {double.turns}\n  floats {single.steady:.3g} {single.turns}")
    assert max(most for outcome in (single, double) for turns in outcome.turns for most in turns) <= 12
