"""A scenario's law as a package for ROS 2."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import slidax
from slidax._errors import DefinitionError, shown
from slidax._names import are_numbered
from slidax._writing import write_text
from slidax.scenarios import Scenario

from ..contents import Project
from ..onboard import Allowed, weight_by_robot, write_law, write_onboard
from ..onboard.gravity import own_plant
from ..project import write_files, writing
from .node import Node
from .parameters import Declared, as_list, as_text, declared, yaml

FILES = {
    "ros2/controller.hpp.j2": "include/slidax_{name}_controller/controller.hpp",
    "ros2/controller.cpp.j2": "src/controller.cpp",
    "ros2/plugin.xml.j2": "slidax_{name}_controller.xml",
    "ros2/package.xml.j2": "package.xml",
    "ros2/CMakeLists.txt.j2": "CMakeLists.txt",
    "ros2/controllers.yaml.j2": "config/controllers.yaml",
    "ros2/control.launch.py.j2": "launch/control.launch.py",
    "ros2/README.md.j2": "README.md",
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
    """Write a package with a controller for ros2_control and a node in Python, and the law that both run.

    Trajectories arrive by a topic; the scenario's motion is not used.

    - `name`, `single`, `command`: as in `export_c`.
    - `gravity`: "law" if the law carries the arm's weight, "robot" if the robot adds it to each effort.
    - `golden`: include the tests and golden samples, which take most of the time.

    Raises DefinitionError if the scenario cannot be exported.
    """
    if gravity not in ("law", "robot"):
        raise DefinitionError(f'`gravity` must be "law" or "robot"; got "{gravity}"')
    carried = gravity == "robot"
    fitted = weight_by_robot(scenario) if carried else scenario
    exported = write_law(fitted, out / "law", name=name, single=single, command=command, golden=golden)
    allowed = Allowed.of(fitted, exported, carried=carried)
    package = f"slidax_{exported.name}_controller"
    names = interface_names(own_plant(scenario).robot.joint_names)
    rows = declared(exported, allowed, names)
    values: dict[str, Any] = {
        "o": allowed,
        "package": package,
        "rows": rows,
        "law_rows": [row for row in rows if row.member is not None],
        "joints": as_list(map(as_text, names)),
        "rate": round(1.0 / exported.period),
        "carried": carried,
        "version": slidax.__version__,
        "signals": _signals(exported),
    }
    write_onboard(exported, allowed, out, {"node.py": Node}, names)
    write_files(exported, out, FILES, **values)
    with writing(out):
        write_text(out / "src" / "parameters.yaml", yaml(package, rows))
    return exported


def interface_names(joints: Sequence[str]) -> list[str]:
    """Joint names of the hardware's interfaces: those of the robot's file; `joint 1` becomes `joint_1`.

    Raises DefinitionError for a name that a ROS 2 parameter file cannot hold.
    """
    if are_numbered(joints):
        return [name.replace(" ", "_") for name in joints]
    for name in joints:
        if not name.isprintable() or '"' in name or "\\" in name:
            raise DefinitionError(
                f"joint {shown(name)}: a name with a quotation mark, a backslash or a control character cannot be "
                "used in a ROS 2 parameter file: rename the joint in the robot's and the hardware's files"
            )
    return list(joints)


def _signals(exported: Project) -> list[tuple[str, int]]:
    """Signals of the law to publish, with their sizes."""
    return [(each.name, each.size) for each in exported.outputs if each.type == "f64"]


__all__ = ["Declared", "export_ros2"]
