"""The exported step in ROS 2: a graph of two processes by PyPI's wheels, and the controller built where colcon is."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
from pathlib import Path
from typing import Any

from benchmarks.targets import Row
from slidax import scenarios
from slidax.deploy.onboard.law import Law
from slidax.deploy.ros2 import export_ros2

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
SCENARIO = "example-4.1-1khz"
STEPS = 3000
DOMAIN = "77"
"""Of the graph: not one that others use by itself."""


def python() -> Path | None:
    """The Python with rclpy: $SLIDAX_ROS_PYTHON, or `.venv-ros` here; None without."""
    found = Path(os.environ.get("SLIDAX_ROS_PYTHON", ROOT / ".venv-ros" / "bin" / "python"))
    return found if found.is_file() else None


def rows(folder: Path) -> list[Row]:
    """The node in its graph, and the controller's package where colcon is.

    - `folder`: for what is made.
    """
    import jax

    jax.config.update("jax_enable_x64", True)
    made = [Row("ROS 2, node in Python", missing="rclpy, in an environment .venv-ros (docs/ros2.md)")]
    if python() is not None:
        export_ros2(scenarios.load(SCENARIO), folder, name="law", golden=False)
        Law(folder / "law")
        said = exchanged(folder, STEPS)
        made = [
            Row(
                "ROS 2, node in Python",
                compiled_by=_line(["cc", "--version"]),
                run_by="rclpy and Fast DDS, two processes",
                step=f"{said['received']} of {said['sent']} states answered, {said['off']:.1e} rad from the goal",
            )
        ]
    if shutil.which("colcon") is None or not os.environ.get("ROS_DISTRO"):
        return [*made, Row("ROS 2, controller for ros2_control", missing="ROS 2 itself, with colcon")]
    source = folder / "workspace" / "src" / "controller"
    export_ros2(scenarios.load(SCENARIO), source, name="law", golden=False)
    done = subprocess.run(["colcon", "build"], cwd=folder / "workspace", capture_output=True, text=True, check=False)
    step, by = "built" if done.returncode == 0 else "did not build", f"colcon, {os.environ['ROS_DISTRO']}"
    return [*made, Row("ROS 2, controller for ros2_control", compiled_by=by, step=step)]


def exchanged(folder: Path, steps: int) -> dict[str, Any]:
    """The node and the arm in two processes; what the arm's says.

    - `folder`: with the exported package and the compiled law.
    - `steps`: how many states are sent.

    Raises RuntimeError if a process fails.
    """
    environment = {**os.environ, "PYTHONPATH": "", "ROS_DOMAIN_ID": DOMAIN, "ROS_LOCALHOST_ONLY": "1"}
    environment |= {"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST", "ROS_LOG_DIR": str(folder / "ros_log")}
    said = folder / "node.txt"
    with said.open("w") as file:
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
        raise RuntimeError(f"{arm.stderr[-2000:]}\n{said.read_text()[-2000:]}")
    found: dict[str, Any] = json.loads(arm.stdout.splitlines()[-1])
    return found


def _line(command: list[str]) -> str:
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout.splitlines()[0]
