"""The controller's package built by colcon, with Debian's ament and pluginlib, and headers of our own for the rest."""

import os
import shutil
import subprocess
from pathlib import Path

from ruamel.yaml import YAML

from slidax.export.ros2 import export_ros2
from tests.export.ros2.test_controller import PACKAGE, STUBS, header

SHARE = Path("/usr/share")
OURS = ("control_msgs", "controller_interface", "rclcpp", "rclcpp_action", "rclcpp_lifecycle", "realtime_tools")
OURS += ("std_msgs", "trajectory_msgs")
"""Packages that Debian lacks."""

CONFIG = """
add_library({name}::{name} INTERFACE IMPORTED)
set_target_properties({name}::{name} PROPERTIES INTERFACE_INCLUDE_DIRECTORIES "{headers}")
set({name}_TARGETS {name}::{name})
"""

PARAMETERS = """
function(generate_parameter_library name file)
  if(NOT EXISTS ${{CMAKE_CURRENT_SOURCE_DIR}}/${{file}})
    message(FATAL_ERROR "no ${{file}}")
  endif()
  add_library(${{name}} INTERFACE)
  target_include_directories(${{name}} INTERFACE "{headers}")
endfunction()
"""


def missing():
    if not shutil.which("colcon"):
        return "colcon (pip install colcon-ros colcon-cmake)"
    if not all((SHARE / name / "cmake").is_dir() for name in ("ament_cmake", "pluginlib")):
        return "Debian's ament-cmake and pluginlib-dev"
    return ""


def built(scenario, folder):
    """Return the output of colcon; the package is in `folder/install`.

    - `scenario`: whose law is exported.
    - `folder`: for the workspace.
    """
    source, prefix, headers = folder / "src", folder / "prefix", folder / "headers"
    export_ros2(scenario, source / PACKAGE, name="law", golden=False)
    # pluginlib is the real one.
    shutil.copytree(STUBS, headers, ignore=shutil.ignore_patterns("pluginlib", "*.cpp"))
    (headers / PACKAGE).mkdir()
    parameters = YAML(typ="safe").load((source / PACKAGE / "src" / "parameters.yaml").read_text())
    (headers / PACKAGE / "parameters.hpp").write_text(header(parameters))
    for name in (*OURS, "generate_parameter_library"):
        place = prefix / "share" / name / "cmake"
        place.mkdir(parents=True)
        text = PARAMETERS if name not in OURS else CONFIG
        (place / f"{name}Config.cmake").write_text(text.format(name=name, headers=headers))
    command = ["colcon", "build", "--event-handlers", "console_direct+", "--cmake-args", "-Wno-dev"]
    # Debian's ament is in Debian's Python.
    command += ["-DPython3_EXECUTABLE=/usr/bin/python3"]
    return subprocess.run(
        command,
        cwd=folder,
        env={**os.environ, "CMAKE_PREFIX_PATH": str(prefix), "COLCON_HOME": str(folder / "colcon")},
        capture_output=True,
        text=True,
        check=False,
    )
