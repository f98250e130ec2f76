"""A scenario's law as a C project: library, header, tests, benchmark, example and instructions."""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

from slidax._errors import DefinitionError
from slidax._writing import reason, write_text
from slidax.actuators import TorqueLimits
from slidax.codegen.c import Dialect, Helpers
from slidax.simulation import MujocoPlant

from .comment_text import comment
from .contents import Joint, Project
from .golden import golden
from .guarded_step import GuardedStep
from .in_floats import fits
from .programs import arm_program, motion_program, step_programs
from .source import body, source
from .text import render

if TYPE_CHECKING:
    from slidax.scenarios import Scenario

LONGEST_NAME = 40
FILES = {
    "header.h.j2": "{prefix}.h",
    "step.c.j2": "{prefix}.c",
    "wrapper.hpp.j2": "{prefix}.hpp",
    "scenario.h.j2": "{prefix}_scenario.h",
    "scenario.c.j2": "{prefix}_scenario.c",
    "golden.h.j2": "golden.h",
    "test.c.j2": "test_{name}.c",
    "latency.c.j2": "latency.c",
    "example.c.j2": "example.c",
    "CMakeLists.txt.j2": "CMakeLists.txt",
    "README.md.j2": "README.md",
    "clang-tidy.j2": ".clang-tidy",
}
"""Templates, and the files that they become."""

STEP = ("header.h.j2", "step.c.j2", "wrapper.hpp.j2", "scenario.h.j2", "scenario.c.j2")
"""Of those, what a program needs: all but tests and their golden samples."""


def export_c(
    scenario: Scenario, out: Path, *, name: str | None = None, single: bool = False, command: str = ""
) -> Project:
    """Writes a scenario's law as a C project.

    - `scenario`: whose law, limits, motion and arm.
    - `out`: the folder; made if it is not there, files of the same names are overwritten.
    - `name`: of the law in C; after the scenario if None.
    - `single`: floats in place of doubles.
    - `command`: that asked for it, for the headers.

    Raises DefinitionError if there is no native code for the law, the name is not one in C, or the folder cannot be
    made.
    """
    made = project(scenario, name=name, single=single, command=command)
    write_files(made, out, FILES)
    return made


def write_files(made: Project, out: Path, templates: Iterable[str]) -> None:
    """Writes files of a project.

    - `made`: the project.
    - `out`: the folder; made if it is not there.
    - `templates`: of the files, of those in `FILES`.

    Raises DefinitionError if the folder cannot be made or written.
    """
    try:
        out.mkdir(parents=True, exist_ok=True)
        for template in templates:
            path = out / FILES[template].format(prefix=made.prefix, name=made.name)
            write_text(path, render(template, {"x": made}))
    except OSError as error:
        raise DefinitionError(f"cannot write the project to `{out}`: {reason(error)}") from None


def project(
    scenario: Scenario,
    *,
    name: str | None = None,
    single: bool = False,
    command: str = "",
    with_golden: bool = True,
) -> Project:
    """What `export_c` writes.

    - `scenario`: whose law, limits, motion and arm.
    - `name`: of the law in C; after the scenario if None.
    - `single`: floats in place of doubles.
    - `command`: that asked for it, for the headers.
    - `with_golden`: whether golden samples are computed, which takes most of the time.

    Raises DefinitionError if there is no native code for the law, or the name is not one in C.
    """
    name = _checked_name(scenario.name if name is None else name, given=name is not None)
    plant = scenario.plant.own if isinstance(scenario.plant, MujocoPlant) else scenario.plant
    described, robot, actuator = scenario.description, plant.robot, plant.actuator
    limits = TorqueLimits() if actuator is None else actuator.limits
    guard = GuardedStep.around(scenario.controller, limits, scenario.period)
    dialect = Dialect("float" if single else "double")
    step = step_programs(guard, dialect.real)
    same = not single or fits(step.answered.program)
    helpers = Helpers(dialect)
    of_motion, of_arm = motion_program(scenario.trajectory, robot.joints), arm_program(plant)
    motion = body(of_motion, dialect, ("t", "period", "reference"), helpers)
    arm = body(of_arm, dialect, ("t", "q", "dq", "tau", "ddq"), helpers)
    return Project(
        name=name,
        title=comment(described.title),
        law=f"{scenario.scheme} on {scenario.robot}",
        command=command,
        joints=tuple(
            Joint(unit, f"{unit}/s", torque) for unit, torque in zip(robot.joint_units, robot.torque_units, strict=True)
        ),
        dialect=dialect,
        guard=guard,
        step=step,
        source=source(step, dialect),
        motion=motion,
        arm=arm,
        scenario_helpers=helpers.lines,
        tables=[*of_motion.tables, *of_arm.tables],
        golden=golden(scenario, guard, dialect.real, same=same) if with_golden else None,
        period=scenario.period,
        t1=scenario.t1,
        delay=round(described.sensor.delay + described.actuator.dead_time),
        start=(scenario.state0.q.tolist(), scenario.state0.dq.tolist()),
    )


def _checked_name(name: str, *, given: bool) -> str:
    cleaned = name if given else re.sub(r"\W+", "_", comment(name)).strip("_").lower()
    if not re.fullmatch(r"[a-z][a-z0-9_]*", cleaned) or len(cleaned) > LONGEST_NAME:
        raise DefinitionError(
            f"the name in C must be small letters, digits and _, a letter first, at most {LONGEST_NAME} of them; "
            f"got `{cleaned}`: give another with `--name`"
        )
    return cleaned
