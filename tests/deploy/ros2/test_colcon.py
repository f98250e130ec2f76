"""The controller's package is built by colcon, with ROS 2's own ament and pluginlib, and else headers of our own."""

from __future__ import annotations

import ctypes
import os
import shutil
import subprocess
from pathlib import Path
from xml.etree import ElementTree

import pytest
from ruamel.yaml import YAML

from slidax import scenarios
from slidax.deploy.ros2 import export_ros2
from tests.deploy.ros2.test_controller import PACKAGE, STUBS, header

SHARES = (Path("/usr/share"), Path("/opt/ros"))
pytestmark = [
    pytest.mark.full,
    pytest.mark.skipif(not shutil.which("colcon"), reason="colcon is not here (pip install colcon-ros colcon-cmake)"),
    pytest.mark.skipif(
        not all((SHARES[0] / name / "cmake").is_dir() for name in ("ament_cmake", "pluginlib")),
        reason="Debian's ament-cmake and pluginlib-dev are not here",
    ),
]

OURS = ("controller_interface", "rclcpp", "rclcpp_lifecycle", "realtime_tools", "std_msgs", "trajectory_msgs")
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


def test_it_is_built_and_found_as_a_plugin(tmp_path: Path) -> None:
    source, prefix, headers = tmp_path / "src", tmp_path / "prefix", tmp_path / "headers"
    scenario = scenarios.load("example-4.1-1khz", {"scheme": {"name": "computed_torque"}})
    export_ros2(scenario, source / PACKAGE, name="law", golden=False)
    # pluginlib is the real one.
    shutil.copytree(STUBS, headers, ignore=shutil.ignore_patterns("pluginlib", "main.cpp"))
    (headers / PACKAGE).mkdir()
    parameters = YAML(typ="safe").load((source / PACKAGE / "src" / "parameters.yaml").read_text())
    (headers / PACKAGE / "parameters.hpp").write_text(header(parameters))
    for name in (*OURS, "generate_parameter_library"):
        folder = prefix / "share" / name / "cmake"
        folder.mkdir(parents=True)
        text = PARAMETERS if name not in OURS else CONFIG
        (folder / f"{name}Config.cmake").write_text(text.format(name=name, headers=headers))
    command = ["colcon", "build", "--event-handlers", "console_direct+", "--cmake-args", "-Wno-dev"]
    # Debian's ament is in Debian's Python.
    command += ["-DPython3_EXECUTABLE=/usr/bin/python3"]
    done = subprocess.run(
        command,
        cwd=tmp_path,
        env={**os.environ, "CMAKE_PREFIX_PATH": str(prefix), "COLCON_HOME": str(tmp_path / "colcon")},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert "warning:" not in done.stdout + done.stderr, done.stdout
    installed = tmp_path / "install" / PACKAGE
    index = installed / "share" / "ament_index" / "resource_index"
    assert (index / "packages" / PACKAGE).is_file()
    told = (index / "controller_interface__pluginlib__plugin" / PACKAGE).read_text().strip()
    library = ElementTree.parse(installed / told).getroot().get("path")
    # All that it needs is in it, or in what it is linked to.
    ctypes.CDLL(str(installed / "lib" / f"lib{library}.so"), mode=os.RTLD_NOW)
    assert (installed / "share" / PACKAGE / "launch").is_dir()
    assert (installed / "share" / PACKAGE / "config").is_dir()
