"""The exported step in ROS 2: a graph of two processes by PyPI's wheels, and the controller built where colcon is."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from benchmarks.targets import Row
from slidax import scenarios
from slidax.export.onboard.pilot import CompiledLaw
from slidax.export.ros2 import export_ros2
from tests.export.ros2 import colcon

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
SCENARIO = "example-4.1-1khz"
STEPS = 3000
DOMAIN = "77"
"""Of the graph: not one that others use by itself."""


def python() -> Path | None:
    """The Python with rclpy: $SLIDAX_ROS_PYTHON, or `.venv-ros` here; None without."""
    path = Path(os.environ.get("SLIDAX_ROS_PYTHON", ROOT / ".venv-ros" / "bin" / "python"))
    return path if path.is_file() else None


def rows(folder: Path) -> list[Row]:
    """The node in its graph, and the controller's package where colcon is.

    - `folder`: for what is made.
    """
    import jax

    jax.config.update("jax_enable_x64", True)
    table = [Row("ROS 2, node in Python", missing="rclpy, in an environment .venv-ros (docs/ros2.md)")]
    if python() is not None:
        export_ros2(scenarios.load(SCENARIO), folder, name="law", golden=False)
        CompiledLaw(folder / "law")
        counts = exchanged(folder, STEPS)
        table = [
            Row(
                "ROS 2, node in Python",
                compiled_by=_line(["cc", "--version"]),
                run_by="rclpy and Fast DDS, two processes",
                step=f"{counts['received']} of {counts['sent']} states answered, {counts['off']:.1e} rad from the goal",
            )
        ]
    return [*table, _controller(folder)]


def _controller(folder: Path) -> Row:
    """The package by colcon: in ROS 2 itself, or with what Debian has of it."""
    name, scenario = "ROS 2, controller for ros2_control", scenarios.load(SCENARIO)
    distribution = os.environ.get("ROS_DISTRO")
    if distribution and shutil.which("colcon"):
        export_ros2(scenario, folder / "workspace" / "src" / "controller", name="law", golden=False)
        where = folder / "workspace"
        done = subprocess.run(["colcon", "build"], cwd=where, capture_output=True, text=True, check=False)
        by = f"colcon, {distribution}"
    elif reason := colcon.missing():
        return Row(name, missing=f"ROS 2 itself; nor {reason}")
    else:
        done = colcon.built(scenario, folder / "workspace")
        versions = [f"{package} {_version(package)}" for package in ("ament_cmake", "pluginlib")]
        by = f"colcon with {' and '.join(versions)}, and headers of our own for the rest of ROS 2"
    return Row(name, compiled_by=by, step="built" if done.returncode == 0 else "did not build")


def _version(package: str) -> str:
    """Of a package of Debian's ROS 2."""
    version = ElementTree.parse(colcon.SHARE / package / "package.xml").getroot().findtext("version")
    return version or ""


def exchanged(folder: Path, steps: int) -> dict[str, Any]:
    """The node and the arm in two processes; what the arm's says.

    - `folder`: with the exported package and the compiled law.
    - `steps`: how many states are sent.

    Raises RuntimeError if a process fails.
    """
    environment = {**os.environ, "PYTHONPATH": "", "ROS_DOMAIN_ID": DOMAIN, "ROS_LOCALHOST_ONLY": "1"}
    environment |= {"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST", "ROS_LOG_DIR": str(folder / "ros_log")}
    output = folder / "node.txt"
    with output.open("w") as file:
        node = subprocess.Popen([str(python()), "node.py"], cwd=folder, env=environment, stdout=file, stderr=file)
    try:
        arm = subprocess.run(
            [str(python()), str(HERE / "ros2_arm.py"), str(folder), str(steps)],
            cwd=folder,
            env=environment,
            capture_output=True,
            text=True,
            check=False,
            timeout=180,
        )
    finally:
        node.terminate()
        try:
            node.wait(timeout=10)
        except subprocess.TimeoutExpired:
            node.kill()
            node.wait()
    if arm.returncode != 0:
        raise RuntimeError(f"{arm.stderr[-2000:]}\n{output.read_text()[-2000:]}")
    counts: dict[str, Any] = json.loads(arm.stdout.splitlines()[-1])
    return counts


def _line(command: list[str]) -> str:
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout.splitlines()[0]
