import sys
from types import ModuleType

import jax.numpy as jnp
import numpy as np
import pytest

from slidax import arms, scenarios
from slidax.core.errors import DefinitionError
from slidax.scenarios import draft
from slidax.scenarios.named_robot import named_robot
from tests.scenarios.test_draft import arm

DRAKE = """<transmission name="t{i}" xmlns:drake="http://drake.mit.edu"><type>SimpleTransmission</type>
<joint name="{joint}"><hardwareInterface>effort</hardwareInterface></joint>
<actuator name="m{i}"><drake:rotor_inertia value="{inertia}"/><drake:gear_ratio value="{ratio}"/></actuator>
</transmission>"""
ROS = """<transmission name="t{i}"><type>transmission_interface/SimpleTransmission</type><joint name="{joint}"/>
<actuator name="m{i}"><mechanicalReduction>{ratio}</mechanicalReduction>
<motorInertia>{inertia}</motorInertia></actuator>
</transmission>"""


def transmission(form, joint, inertia, ratio):
    return form.format(i=joint, joint=joint, inertia=inertia, ratio=ratio)


@pytest.mark.parametrize("form", [DRAKE, ROS])
def test_a_rotor_adds_its_inertia_times_the_squared_reduction(form):
    text = arm(more=transmission(form, "j2", 2e-5, -100) + transmission(form, "j3", 1e-4, 50))
    read = arms.from_urdf(text)
    assert np.asarray(read.armature).tolist() == pytest.approx([0.0, 0.2, 0.25, 0.0])
    without = arms.from_urdf(text, armature=0.0)
    q = jnp.array([0.1, 0.2, 0.3, 0.4])
    assert np.diag(read.mass(q) - without.mass(q)) == pytest.approx([0.0, 0.2, 0.25, 0.0])


def test_an_armature_argument_replaces_the_files_armature():
    text = arm(more=transmission(ROS, "j2", 2e-5, 100))
    assert np.asarray(arms.from_urdf(text, armature={"j1": 0.3}).armature).tolist() == [0.3, 0.0, 0.0, 0.0]


def test_a_transmission_without_an_inertia_adds_no_armature():
    text = arm(more=ROS.format(i=1, joint="j2", ratio=100, inertia="").replace("<motorInertia></motorInertia>", ""))
    assert not np.asarray(arms.from_urdf(text).armature).any()


@pytest.mark.parametrize(
    ("more", "message"),
    [
        (transmission(ROS, "j2", "heavy", 100), "motorInertia> of transmission `tj2` must be a finite number"),
        (transmission(ROS, "j2", -1e-5, 100), "must have a rotor inertia >= 0 and a ratio other than 0"),
        (transmission(ROS, "j2", 1e-5, 0), "must have a rotor inertia >= 0 and a ratio other than 0"),
        (ROS.format(i=1, joint='j2"/><joint name="j3', ratio=2, inertia=1e-5), "couples several joints or actuators"),
    ],
)
def test_an_invalid_rotor_is_refused_by_name(more, message):
    with pytest.raises(DefinitionError, match=message):
        arms.from_urdf(arm(more=more))


def test_drafted_scenario_has_the_files_rotor_inertias_and_assumes_missing_values(tmp_path):
    path = tmp_path / "four.urdf"
    path.write_text(arm(more=transmission(ROS, "j2", 2e-5, 100)))
    (tmp_path / "four.yaml").write_text(draft(path, folder=tmp_path).text)
    loaded = scenarios.load(tmp_path / "four.yaml")
    assert np.asarray(loaded.plant.robot.armature).tolist() == pytest.approx([0.04, 0.2, 0.03, 0.01])
    assert np.asarray(loaded.controller.nominal.armature).tolist() == pytest.approx([0.0, 0.2, 0.0, 0.0])


@pytest.fixture
def descriptions(tmp_path, monkeypatch):
    """A stand-in for the package robot_descriptions, which downloads its files."""
    (tmp_path / "four.urdf").write_text(arm())
    module = ModuleType("robot_descriptions.four_description")
    module.URDF_PATH = str(tmp_path / "four.urdf")
    package = ModuleType("robot_descriptions")
    package.__path__ = []
    monkeypatch.setitem(sys.modules, "robot_descriptions", package)
    monkeypatch.setitem(sys.modules, "robot_descriptions.four_description", module)
    return module


def test_a_robot_descriptions_name_loads_its_file(descriptions, tmp_path):
    new = draft("four_description", folder=tmp_path)
    assert "file: four.urdf" in new.text and "robot_descriptions" in new.notes[0]
    assert named_robot("four_description")[1] == {"kind": "urdf", "file": descriptions.URDF_PATH}


def test_missing_robot_description_or_package_is_refused_with_a_remedy(descriptions, monkeypatch):
    with pytest.raises(DefinitionError, match="`five_description` is not a robot of robot_descriptions; `python -m"):
        draft("five_description")
    del descriptions.URDF_PATH
    with pytest.raises(DefinitionError, match="has no URDF, MJCF or xacro file"):
        draft("four_description")
    monkeypatch.setitem(sys.modules, "robot_descriptions", None)
    monkeypatch.delitem(sys.modules, "robot_descriptions.four_description")
    with pytest.raises(DefinitionError, match="pip install robot_descriptions"):
        draft("four_description")
