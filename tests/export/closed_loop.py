"""An exported step in a closed loop with its arm, in C: the law in floats or doubles, the arm in doubles."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

from slidax.export.c_project import project
from slidax.export.c_structures import render

from .exported import COMPILERS, compiled, run, write_law

LOOP = """
#include "slidax_law.h"
#include "slidax_arm_scenario.h"
#include <math.h>
#include <stdio.h>

#define MOST 256

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
    unsigned long seen = 0;
    long k;
    int i;
    slidax_law_parameters_default(&parameters);
    slidax_law_reset(&state);
    slidax_arm_start(&plant);
    for (k = 0; k < {steps}; ++k) {{
        const double t = (double)k * {period};
        slidax_arm_motion(t, {period}, &wanted);
        slidax_arm_measure(&plant, &measured);
        measurement.t = ({real})t;
        for (i = 0; i < {n}; ++i) {{
            measurement.q[i] = ({real})measured.q[i];
            measurement.dq[i] = ({real})measured.dq[i];
            reference.q[i] = ({real})wanted.q[i];
            reference.dq[i] = ({real})wanted.dq[i];
            reference.ddq[i] = ({real})wanted.ddq[i];
            reference.q_next[i] = ({real})wanted.q_next[i];
            reference.dq_next[i] = ({real})wanted.dq_next[i];
            reference.ddq_next[i] = ({real})wanted.ddq_next[i];
            if (4 * k > 3 * {steps} && fabs(plant.then[0].q[i] - wanted.q[i]) > worst) {{
                worst = fabs(plant.then[0].q[i] - wanted.q[i]);
            }}
        }}
        for (i = 0; i < {searches}; ++i) {{
            turns[i] = 0;
        }}
        seen |= slidax_law_step(&measurement, &reference, &state, &parameters, &command);
        for (i = 0; i < {n}; ++i) {{
            tau[i] = (double)command.tau[i];
        }}
        for (i = 0; i < {searches}; ++i) {{
            ++histogram[i][turns[i] < MOST ? turns[i] : MOST - 1];
        }}
        slidax_arm_move(&plant, {period}, tau);
    }}
    printf("%lu %.9g\\n", seen, worst);
    for (i = 0; i < {searches}; ++i) {{
        for (k = 0; k < MOST; ++k) {{
            if (histogram[i][k] > 0) {{
                printf("%ld:%ld ", k, histogram[i][k]);
            }}
        }}
        printf("\\n");
    }}
    return 0;
}}
"""


class Kept(NamedTuple):
    """What a closed loop came to.

    - `status`: all bits that a step said.
    - `steady`: the largest error in its last quarter, rad or m.
    - `turns`: for each search of the law, how many turns it took in how many steps.
    """

    status: int
    steady: float
    turns: list[dict[int, int]]


def closed_loop(scenario: Any, folder: Path, *, single: bool) -> Kept:
    """A scenario's loop from its start to its end.

    - `scenario`: whose law and arm.
    - `folder`: for the files.
    - `single`: whether the law computes in floats; the arm has doubles in any case.
    """
    folder.mkdir(exist_ok=True)
    law = project(scenario, name="law", single=single, with_golden=False)
    arm = law if not single else project(scenario, name="law", with_golden=False)
    write_law(law, folder)
    searches = _counted(folder / "slidax_law.c")
    for template, ending in (("header.h.j2", ".h"), ("scenario.h.j2", "_scenario.h"), ("scenario.c.j2", "_scenario.c")):
        text = render(template, {"x": arm}).replace("slidax_law", "slidax_arm").replace("SLIDAX_LAW", "SLIDAX_ARM")
        (folder / f"slidax_arm{ending}").write_text(text)
    steps = round(scenario.t1 / scenario.period)
    made = LOOP.format(n=len(law.joints), real=law.real, steps=steps, period=repr(scenario.period), searches=searches)
    (folder / "loop.c").write_text(made)
    files = ("slidax_law.c", "slidax_arm_scenario.c", "loop.c")
    compiled(COMPILERS[0], folder, "-O2", "-ffp-contract=off", *files, "-o", "loop", "-lm")
    first, *rest = run(folder, "./loop").splitlines()
    status, steady = first.split()
    found = [dict(tuple(map(int, pair.split(":"))) for pair in line.split()) for line in rest]
    return Kept(int(status), float(steady), found)


def _counted(file: Path) -> int:
    """Counts the turns of all loops of a law that end by themselves; returns how many loops those are."""
    lines: list[str] = []
    searches = 0
    for line in file.read_text().splitlines():
        lines.append(line)
        if line.strip() == "for (;;) {" or line.strip().startswith("while ("):
            lines.append(f"++turns[{searches}];")
            searches += 1
    text = "\n".join([*lines, ""])
    file.write_text(text.replace("#include <float.h>", "#include <float.h>\nextern long turns[];", 1))
    return searches
