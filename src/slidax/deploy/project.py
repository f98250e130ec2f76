"""A scenario's law as a C project: library, header, tests, benchmark, example and instructions."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

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

STEP = {
    template: FILES[template]
    for template in ("header.h.j2", "step.c.j2", "wrapper.hpp.j2", "scenario.h.j2", "scenario.c.j2")
}
"""The files that a program needs: all but tests and golden samples."""


def export_c(
    scenario: Scenario, out: Path, *, name: str | None = None, single: bool = False, command: str = ""
) -> Project:
    """Write a scenario's law as a C project to the folder `out`; existing files of the same names are overwritten.

    - `name`: the law's name in C; by default the scenario's.
    - `single`: floats instead of doubles.
    - `command`: the command line, quoted in the file headers.

    Raises DefinitionError if there is no native code for the law, the name is not valid in C, or the folder cannot be
    written.
    """
    exported = project(scenario, name=name, single=single, command=command)
    write_files(exported, out, FILES)
    return exported


def write_files(exported: Project, out: Path, templates: Mapping[str, str], **values: Any) -> None:
    """Write files from templates to the folder `out`.

    - `templates`: file names by template; `{prefix}` and `{name}` in them stand for the law's.
    - `values`: variables of the templates in addition to `x`, the law.

    Raises DefinitionError if the folder cannot be written.
    """
    with writing(out):
        for template, file in templates.items():
            path = out / file.format(prefix=exported.prefix, name=exported.name)
            path.parent.mkdir(parents=True, exist_ok=True)
            write_text(path, render(template, {"x": exported, **values}))


@contextmanager
def writing(out: Path) -> Iterator[None]:
    """Create the folder `out`, and raise a DefinitionError where it or a file in it cannot be written."""
    try:
        out.mkdir(parents=True, exist_ok=True)
        yield
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
    """Return the data that `export_c` writes; golden samples take most of the time.

    Raises DefinitionError if there is no native code for the law, or the name is not valid in C.
    """
    name = _checked_name(scenario.name if name is None else name, clean=name is None)
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
        delay=described.timing.whole_periods,
        start=(scenario.state0.q.tolist(), scenario.state0.dq.tolist()),
    )


def _checked_name(name: str, *, clean: bool) -> str:
    cleaned = re.sub(r"\W+", "_", comment(name)).strip("_").lower() if clean else name
    if not re.fullmatch(r"[a-z][a-z0-9_]*", cleaned) or len(cleaned) > LONGEST_NAME:
        raise DefinitionError(
            f"`{cleaned}` is not a name in C: use small letters, digits and _, a letter first, at most {LONGEST_NAME}: "
            f"`--name NAME`"
        )
    return cleaned
