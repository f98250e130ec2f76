"""The description files of the built-in arms against physics and against other description files of these arms.

The kinematics are computed here in plain NumPy: these tests check the numbers, not their reader.
"""

import sys
import xml.etree.ElementTree as ElementTree
from importlib import metadata
from itertools import pairwise
from pathlib import Path

import equinox as eqx
import numpy as np
import pytest
from ruamel.yaml import YAML

from slidax import arms
from slidax.core.errors import DefinitionError

FOLDER = Path(arms.__file__).parent / "built_in_arms"
FILES = {path.stem: YAML(typ="safe", pure=True).load(path) for path in sorted(FOLDER.glob("*.yaml"))}

KEYS = {"name", "title", "rate", "joints", "tip", "home", "sources"}
JOINT_KEYS = {"name", "kind", "parent", "translation", "turn", "axis", "velocity", "torque", "link"}
JOINT_OPTIONS = {"position", "torque_rate", "armature"}

every_arm = pytest.mark.parametrize("name", FILES)


def turned(axis, angle):
    """The rotation by an angle about a unit axis."""
    x, y, z = axis
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross


def axes_of(turn):
    """Roll, pitch and yaw about fixed axes as a rotation."""
    roll, pitch, yaw = turn
    return turned([0, 0, 1], yaw) @ turned([0, 1, 0], pitch) @ turned([1, 0, 0], roll)


def frames(description, q):
    """Rotation and place of every link's frame in the base frame; the tip's frame is last."""
    rotation, place = np.eye(3), np.zeros(3)
    links = []
    for joint, angle in zip(description["joints"], q, strict=True):
        place = place + rotation @ joint["translation"]
        rotation = rotation @ axes_of(joint["turn"]) @ turned(joint["axis"], angle)
        links.append((rotation, place))
    tip = description["tip"]
    return [*links, (rotation @ axes_of(tip["turn"]), place + rotation @ tip["translation"])]


def gravity_torques(description, q):
    """Torque of every joint at rest [N m]."""
    joints, places = description["joints"], frames(description, q)[:-1]
    centers = [
        place + rotation @ joint["link"]["center"] for (rotation, place), joint in zip(places, joints, strict=True)
    ]
    forces = [[0, 0, -9.81 * joint["link"]["mass"]] for joint in joints]
    return [
        -(rotation @ joint["axis"]) @ np.cross(np.array(centers[i:]) - place, forces[i:]).sum(axis=0)
        for i, ((rotation, place), joint) in enumerate(zip(places, joints, strict=True))
    ]


def limits(description):
    """Lower and upper positions; a continuous joint gets a full turn in each direction."""
    return np.array([joint.get("position", [-2 * np.pi, 2 * np.pi]) for joint in description["joints"]]).T


def postures(description):
    return np.random.default_rng(11).uniform(*limits(description), (100, len(description["joints"])))


ARMS = {"panda", "ur5e", "iiwa14", "xarm7", "gen3"}
"""Names of the built-in arms; a new file needs its name here."""


def test_every_arm_file_has_a_function_of_its_name():
    assert set(FILES) == ARMS == set(arms.built_in_names())
    for name in ARMS:
        make = getattr(arms, name)
        assert make.__name__ == name
        assert FILES[name]["title"] in make.__doc__
        assert eqx.tree_equal(make(), arms.built_in_arm(name).robot)
        assert make().joints == len(FILES[name]["joints"])


def test_an_added_arm_file_is_a_new_arm(tmp_path, monkeypatch):
    text = (FOLDER / "ur5e.yaml").read_text(encoding="utf-8")
    (tmp_path / "scratch.yaml").write_text(text.replace("title: Universal Robots UR5e", "title: Scratch arm"))
    monkeypatch.setattr(sys.modules["slidax.arms.built_in"], "FILES", tmp_path)
    assert arms.built_in_names() == ("scratch",)
    assert arms.built_in_title("scratch") == "Scratch arm, 6 joints"
    arm = arms.built_in_arm("scratch").robot
    np.testing.assert_array_equal(arm.masses, [joint["link"]["mass"] for joint in FILES["ur5e"]["joints"]])
    assert arm.name == "scratch"


def test_unknown_arm_is_an_error_with_the_nearest_name():
    with pytest.raises(DefinitionError, match="no built-in arm `pandas`; did you mean `panda`"):
        arms.built_in_arm("pandas")


@every_arm
def test_an_arm_file_has_exactly_the_known_keys(name):
    description = FILES[name]
    assert set(description) == KEYS
    assert description["name"] == name
    assert set(description["sources"]) == {"kinematics", "inertia", "limits", "rotors"}
    assert all(description["sources"].values())
    for joint in description["joints"]:
        without_end = joint["kind"] == "continuous"
        needed = JOINT_KEYS if without_end else JOINT_KEYS | {"position"}
        assert needed <= set(joint) <= needed | (JOINT_OPTIONS - {"position"} if without_end else JOINT_OPTIONS)
        assert joint["kind"] in ("revolute", "continuous")
        assert set(joint["link"]) == {"name", "mass", "center", "inertia"}


@every_arm
def test_the_joints_are_one_chain_from_the_base_to_the_tip(name):
    joints = FILES[name]["joints"]
    assert joints[0]["parent"] is None
    assert all(after["parent"] == before["name"] for before, after in pairwise(joints))
    assert FILES[name]["tip"]["joint"] == joints[-1]["name"]
    assert len({joint["name"] for joint in joints} | {joint["link"]["name"] for joint in joints}) == 2 * len(joints)


@every_arm
def test_the_home_posture_is_within_the_limits(name):
    lower, upper = limits(FILES[name])
    assert np.all(lower < FILES[name]["home"])
    assert np.all(upper > FILES[name]["home"])


@every_arm
def test_an_arm_can_hold_its_weight_in_every_posture(name):
    torque = [joint["torque"] for joint in FILES[name]["joints"]]
    for q in postures(FILES[name]):
        assert np.all(np.abs(gravity_torques(FILES[name], q)) < torque)


@pytest.mark.parametrize("name", ["panda", "ur5e", "iiwa14", "xarm7"])
def test_flange_points_down_in_the_home_posture(name):
    rotation, _ = frames(FILES[name], FILES[name]["home"])[-1]
    np.testing.assert_allclose(rotation @ [0, 0, 1], [0, 0, -1], atol=2e-3)


SAME_ARM = [
    pytest.param("panda", "panda_description/urdf/panda.urdf", id="panda"),
    pytest.param("xarm7", "xarm_description/urdf/xarm7.urdf", id="xarm7"),
]


def other_file(path):
    """Text of a URDF of example-robot-data, with its rounded quarter turns replaced by exact angles."""
    try:
        package = metadata.distribution("example-robot-data")
    except metadata.PackageNotFoundError:
        pytest.skip("example-robot-data is not installed")
    file = package.locate_file(f"cmeel.prefix/share/example-robot-data/robots/{path}")
    text = Path(str(file)).read_text(encoding="utf-8")
    return text.replace("1.5708 ", f"{np.pi / 2!r} ")


@pytest.mark.parametrize(("name", "path"), SAME_ARM)
def test_built_in_links_and_limits_agree_with_example_robot_data(name, path):
    tree = ElementTree.fromstring(other_file(path))
    for joint in FILES[name]["joints"]:
        inertial = tree.find(f"./link[@name='{joint['link']['name']}']/inertial")
        inertia, origin = inertial.find("inertia"), inertial.find("origin")
        assert [float(x) for x in origin.get("rpy").split()] == [0, 0, 0]
        assert joint["link"]["mass"] == float(inertial.find("mass").get("value"))
        assert joint["link"]["center"] == [float(x) for x in origin.get("xyz").split()]
        assert joint["link"]["inertia"] == [float(inertia.get(k)) for k in ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")]
        limit = tree.find(f"./joint[@name='{joint['name']}']/limit")
        assert [*joint["position"], joint["velocity"], joint["torque"]] == [
            float(limit.get(k)) for k in ("lower", "upper", "velocity", "effort")
        ]


def test_ur5e_has_the_axes_and_link_lengths_of_the_ur5():
    """The UR5 is the older arm of the same build: other offsets along the axes, the same directions and almost the
    same lengths of upper arm and forearm.
    """
    pinocchio = pytest.importorskip("pinocchio")
    model = pinocchio.buildModelFromXML(other_file("ur_description/urdf/ur5_robot.urdf"))
    data = model.createData()
    description = FILES["ur5e"]
    names = [joint["name"] for joint in description["joints"]]
    assert list(model.names)[1:] == names
    for q in postures(description):
        jacobian = pinocchio.computeJointJacobians(model, data, q)
        ours = frames(description, q)[:-1]
        axes = np.array([rotation[:, 2] for rotation, _ in ours])
        np.testing.assert_allclose(axes, jacobian[3:].T, rtol=0, atol=1e-6)
        for first, second in ((1, 2), (2, 3)):  # along the arm, across the three axes that stay parallel
            across = np.eye(3) - np.outer(axes[1], axes[1])
            length = np.linalg.norm(across @ (ours[second][1] - ours[first][1]))
            theirs = np.linalg.norm(across @ (data.oMi[second + 1].translation - data.oMi[first + 1].translation))
            assert length == pytest.approx(theirs, abs=1e-4)
