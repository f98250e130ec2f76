import ctypes
import os
from xml.etree import ElementTree

import pytest

from slidax import scenarios
from tests.export.ros2 import colcon
from tests.export.ros2.test_controller import PACKAGE

pytestmark = [pytest.mark.full, pytest.mark.skipif(bool(colcon.missing()), reason=f"not here: {colcon.missing()}")]


def test_colcon_builds_the_controller_and_registers_it_as_a_plugin(tmp_path):
    done = colcon.built(scenarios.load("example-4.1-1khz", {"scheme": {"name": "computed_torque"}}), tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "warning:" not in done.stdout + done.stderr, done.stdout
    installed = tmp_path / "install" / PACKAGE
    index = installed / "share" / "ament_index" / "resource_index"
    assert (index / "packages" / PACKAGE).is_file()
    printed = (index / "controller_interface__pluginlib__plugin" / PACKAGE).read_text().strip()
    library = ElementTree.parse(installed / printed).getroot().get("path")
    # All that it needs is in it, or in what it is linked to.
    ctypes.CDLL(str(installed / "lib" / f"lib{library}.so"), mode=os.RTLD_NOW)
    assert (installed / "share" / PACKAGE / "launch").is_dir()
    assert (installed / "share" / PACKAGE / "config").is_dir()
