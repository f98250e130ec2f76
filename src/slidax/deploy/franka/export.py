"""A scenario's law as a program for a Franka arm."""

from __future__ import annotations

from pathlib import Path

from slidax._errors import DefinitionError
from slidax._writing import reason, write_text
from slidax.scenarios import Scenario

from ..contents import Project
from ..onboard import Allowed, weight_by_robot, write_law, write_onboard
from ..text import render
from . import program

HERE = "slidax.deploy.franka"
FILES = {"main.cpp.j2": "main.cpp", "CMakeLists.txt.j2": "CMakeLists.txt", "README.md.j2": "README.md"}
JOINTS, PERIOD = 7, 1e-3
LOST = 20
"""So many packets lost in a row end a motion, by the robot's own rule."""


def export_franka(
    scenario: Scenario,
    out: Path,
    *,
    name: str | None = None,
    single: bool = False,
    command: str = "",
    golden: bool = True,
) -> Project:
    """Writes a program for libfranka, its like for pylibfranka, and the law that both run.

    - `scenario`: whose law and motion; of an arm with 7 joints, at 1 kHz.
    - `out`: the folder; made if it is not there.
    - `name`: of the law in C; after the scenario if None.
    - `single`: floats in place of doubles.
    - `command`: that asked for it, for the headers.
    - `golden`: whether the law comes with its tests and golden samples, which take most of the time.

    Raises DefinitionError if the scenario is not one for this robot, or cannot be exported.
    """
    joints = scenario.state0.q.size
    if joints != JOINTS:
        raise DefinitionError(f"a Franka arm has {JOINTS} joints; the robot of `{scenario.name}` has {joints}")
    if abs(scenario.period - PERIOD) > 1e-9:
        raise DefinitionError(
            f"`simulation.period` must be 0.001 s, at which a Franka arm takes torques; got {scenario.period:g}: "
            "`--set simulation.period=1e-3`"
        )
    fitted = weight_by_robot(scenario)
    made = write_law(fitted, out / "law", name=name, single=single, command=command, golden=golden)
    allowed = Allowed.of(fitted, made, lost=LOST, carried=True)
    try:
        write_onboard(made, allowed, out, [program])
        for template, file in FILES.items():
            write_text(out / file, render(template, {"x": made, "o": allowed}, HERE))
    except OSError as error:
        raise DefinitionError(f"cannot write the project to `{out}`: {reason(error)}") from None
    return made
