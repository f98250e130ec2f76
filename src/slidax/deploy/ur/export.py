"""A scenario's law as a program for an arm of Universal Robots."""

from __future__ import annotations

from pathlib import Path

from slidax._errors import DefinitionError
from slidax._writing import reason, write_text
from slidax.scenarios import Scenario

from ..contents import Project
from ..onboard import Allowed, weight_by_robot, write_law, write_onboard
from ..text import render
from . import program

HERE = "slidax.deploy.ur"
JOINTS, PERIOD = 6, 2e-3
LOST = 10
"""So many periods without a state end a motion: the robot itself leaves torque control as soon as commands stop."""


def export_ur(
    scenario: Scenario,
    out: Path,
    *,
    name: str | None = None,
    single: bool = False,
    command: str = "",
    golden: bool = True,
) -> Project:
    """Writes a program for ur_rtde, and the law that it runs.

    - `scenario`: whose law and motion; of an arm with 6 joints, at 500 Hz.
    - `out`: the folder; made if it is not there.
    - `name`: of the law in C; after the scenario if None.
    - `single`: floats in place of doubles.
    - `command`: that asked for it, for the headers.
    - `golden`: whether the law comes with its tests and golden samples, which take most of the time.

    Raises DefinitionError if the scenario is not one for this robot, or cannot be exported.
    """
    joints = scenario.state0.q.size
    if joints != JOINTS:
        raise DefinitionError(
            f"an arm of Universal Robots has {JOINTS} joints; the robot of `{scenario.name}` has {joints}"
        )
    if abs(scenario.period - PERIOD) > 1e-9:
        raise DefinitionError(
            f"`simulation.period` must be 0.002 s, at which these arms take torques; got {scenario.period:g}: "
            "`--set simulation.period=2e-3`"
        )
    fitted = weight_by_robot(scenario)
    made = write_law(fitted, out / "law", name=name, single=single, command=command, golden=golden)
    allowed = Allowed.of(fitted, made, lost=LOST, carried=True)
    try:
        write_onboard(made, allowed, out, [program])
        write_text(out / "README.md", render("README.md.j2", {"x": made, "o": allowed}, HERE))
    except OSError as error:
        raise DefinitionError(f"cannot write the project to `{out}`: {reason(error)}") from None
    return made
