"""A scenario's law as a package for ROS 2."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import slidax
from slidax._errors import DefinitionError, shown
from slidax._names import are_numbered
from slidax._writing import reason, write_text
from slidax.scenarios import Scenario

from ..contents import Project
from ..onboard import Allowed, weight_by_robot, write_law, write_onboard
from ..onboard.gravity import own_plant
from ..text import render
from . import node
from .parameters import Declared, as_list, as_text, declared, yaml

HERE = "slidax.deploy.ros2"
FILES = {
    "controller.hpp.j2": "include/{package}/controller.hpp",
    "controller.cpp.j2": "src/controller.cpp",
    "plugin.xml.j2": "{package}.xml",
    "package.xml.j2": "package.xml",
    "CMakeLists.txt.j2": "CMakeLists.txt",
    "controllers.yaml.j2": "config/controllers.yaml",
    "control.launch.py.j2": "launch/control.launch.py",
    "README.md.j2": "README.md",
}
"""Templates, and the files that they become."""


def export_ros2(
    scenario: Scenario,
    out: Path,
    *,
    name: str | None = None,
    single: bool = False,
    command: str = "",
    gravity: str = "law",
    golden: bool = True,
) -> Project:
    """Writes a package with a controller for ros2_control and a node in Python, and the law that both run.

    - `scenario`: whose law; its motion is not used, as trajectories come by a topic.
    - `out`: the folder; made if it is not there.
    - `name`: of the law in C; after the scenario if None.
    - `single`: floats in place of doubles.
    - `command`: that asked for it, for the headers.
    - `gravity`: who carries the arm's weight: "law", or "robot" if that adds it to each effort.
    - `golden`: whether the law comes with its tests and golden samples, which take most of the time.

    Raises DefinitionError if the scenario cannot be exported.
    """
    if gravity not in ("law", "robot"):
        raise DefinitionError(f'`gravity` must be "law" or "robot"; got "{gravity}"')
    carried = gravity == "robot"
    fitted = weight_by_robot(scenario) if carried else scenario
    made = write_law(fitted, out / "law", name=name, single=single, command=command, golden=golden)
    allowed = Allowed.of(fitted, made, carried=carried)
    package = f"slidax_{made.name}_controller"
    names = interface_names(own_plant(scenario).robot.joint_names)
    rows = declared(made, allowed, names)
    values: dict[str, Any] = {
        "x": made,
        "o": allowed,
        "package": package,
        "rows": rows,
        "law_rows": [row for row in rows if row.member is not None],
        "joints": as_list(map(as_text, names)),
        "rate": round(1.0 / made.period),
        "carried": carried,
        "version": slidax.__version__,
        "signals": _signals(made),
    }
    try:
        write_onboard(made, allowed, out, [node], names)
        for template, file in FILES.items():
            path = out / file.format(package=package)
            path.parent.mkdir(parents=True, exist_ok=True)
            write_text(path, render(template, values, HERE))
        write_text(out / "src" / "parameters.yaml", yaml(package, rows))
    except OSError as error:
        raise DefinitionError(f"cannot write the project to `{out}`: {reason(error)}") from None
    return made


def interface_names(joints: Sequence[str]) -> list[str]:
    """The joints as the hardware's interfaces name them: exactly as the robot's file does.

    - `joints`: the robot's names. A joint without one, `joint 1`, becomes `joint_1`.

    Raises DefinitionError for a name that no parameter file of ROS 2 can hold.
    """
    if are_numbered(joints):
        return [name.replace(" ", "_") for name in joints]
    for name in joints:
        if not name.isprintable() or '"' in name or "\\" in name:
            raise DefinitionError(
                f"joint {shown(name)}: a name with a quotation mark, a backslash or a control character cannot stand "
                "in a parameter file of ROS 2: rename the joint in the robot's file, and in that of the hardware"
            )
    return list(joints)


def _signals(made: Project) -> list[tuple[str, int]]:
    """What is published beside errors, margin and status: each signal of the law, with how many numbers it has."""
    return [(each.name, each.size) for each in made.outputs if each.type == "f64"]


__all__ = ["Declared", "export_ros2"]
