"""Arms from URDF files."""

from __future__ import annotations

from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from slidax.arms import from_mjcf, from_urdf
from slidax.core.errors import DefinitionError, DefinitionWarning
from tests.arms.bad_file import changed
from tests.arms.bad_urdf import AXIS, ELBOW, FORE, GOOD, INERTIA, LIMIT, ORIGIN, TOOL, limit
from tests.paper_examples import SCARA, TWO_LINK

pytest.importorskip("mujoco")
EXAMPLES = Path(__file__).parents[2] / "examples" / "robots"
STATES = np.random.default_rng(3).uniform(-3.0, 3.0, (2, 50, 3))
GRAVITY = (0.0, -9.8, 0.0)
PAPER = [
    pytest.param(lambda file: from_urdf(file, gravity=GRAVITY, armature=[5.0, 5.0]), "two_link.urdf", TWO_LINK),
    pytest.param(from_mjcf, "two_link.xml", TWO_LINK, marks=pytest.mark.full),
    pytest.param(lambda file: from_urdf(file, gravity=(0.0, 0.0, -9.8)), "scara.urdf", SCARA, marks=pytest.mark.full),
]
MIMIC = '<mimic joint="shoulder" multiplier="2" offset="0.5"/>'


@pytest.mark.parametrize(("read", "file", "printed"), PAPER)
def test_robot_files_of_the_paper_arms_agree_with_their_formulas(read, file, printed):
    arm = read(EXAMPLES / file)
    assert arm.joint_units == printed.joint_units
    q, dq = STATES[:, :, : printed.joints]

    def motion(robot, q, dq):
        return robot.mass(q), robot.bias(q, dq), robot.tip(q), robot.potential(q) - robot.potential(jnp.zeros_like(q))

    motions = jax.jit(jax.vmap(motion, (None, 0, 0)))
    for ours, theirs in zip(motions(arm, q, dq), motions(printed, q, dq), strict=True):
        np.testing.assert_allclose(ours, theirs, rtol=1e-12, atol=1e-12)


def test_arm_has_the_parameters_of_the_urdf():
    arm = from_urdf(GOOD)
    assert (arm.name, arm.joint_names, arm.link_names) == ("arm", ("shoulder", "elbow"), ("upper", "fore"))
    limits = {"lower": [-2.0, -1.0], "upper": [2.5, 1.5], "torque": [50.0, 20.0], "velocity": [3.0, 4.0]}
    links = {"viscous": [0.5, 0.0], "coulomb": [0.25, 0.0], "masses": [2.0, 1.25], "armature": [0.0, 0.0]}
    for owner, numbers in ((arm.limits, limits), (arm, links)):
        for field, values in numbers.items():
            np.testing.assert_array_equal(getattr(owner, field), values, err_msg=field)
    np.testing.assert_allclose(arm.gravity_vector, [0.0, 0.0, -9.81])
    # The axes of the upper arm's inertia are turned by 0.3 rad about x.
    turn = np.array([[1.0, 0.0, 0.0], [0.0, np.cos(0.3), -np.sin(0.3)], [0.0, np.sin(0.3), np.cos(0.3)]])
    inertia = np.array([[0.02, 0.001, 0.0], [0.001, 0.03, 0.0], [0.0, 0.0, 0.04]])
    np.testing.assert_allclose(arm.inertias[0], turn @ inertia @ turn.T, rtol=1e-13, atol=1e-16)
    # The shoulder's origin is turned by (0.1, 0.2, 0.3) rad about fixed axes; the tip is 0.6 m along its x axis.
    cosine, sine = np.cos([0.1, 0.2, 0.3]), np.sin([0.1, 0.2, 0.3])
    along_x = [cosine[1] * cosine[2], cosine[1] * sine[2], -sine[1]]
    np.testing.assert_allclose(arm.tip(jnp.zeros(2)), 0.6 * np.array(along_x) + [0.0, 0.0, 0.3], rtol=1e-14)


MOUNT = (
    '<link name="base"/><joint name="bolts" type="fixed"><parent link="base"/><child link="mount"/></joint>'
    f'<link name="mount"><inertial><mass value="-1"/>{INERTIA}</inertial></link>'
)
GAZEBO = '<gazebo reference="fore"><mu1>nan</mu1></gazebo><mujoco><compiler inertiafromgeom="true"/></mujoco></robot>'
SAME = {
    "a byte order mark": "\ufeff" + GOOD,
    "a longer axis": changed(GOOD, AXIS, '<axis xyz="0 2.5 0"/>'),
    "a mount of negative mass": GOOD.replace('t link="base"', 't link="mount"').replace('<link name="base"/>', MOUNT),
    "a link named world": GOOD.replace('"upper"', '"world"'),
    "elements of other programs": changed(GOOD, "</robot>", GAZEBO, ORIGIN, ORIGIN + "<hardware_interface/>"),
}


@pytest.mark.parametrize("name", SAME)
def test_equivalent_urdf_texts_give_the_same_arm(name, tmp_path):
    text, good = SAME[name], from_urdf(GOOD)
    accuracy = 1e-14 if name == "a longer axis" else 0.0
    (tmp_path / "arm.urdf").write_text(text)
    (tmp_path / "wide.urdf").write_bytes(text.lstrip("\ufeff").replace("utf-8", "utf-16").encode("utf-16"))
    for source in (text, tmp_path / "arm.urdf", str(tmp_path / "arm.urdf"), tmp_path / "wide.urdf"):
        for field in ("masses", "inertias", "rotations"):
            numbers = getattr(from_urdf(source), field)
            np.testing.assert_allclose(numbers, getattr(good, field), rtol=accuracy, atol=accuracy)


def test_default_joint_axis_is_x():
    about_x = from_urdf(changed(GOOD, AXIS, '<axis xyz="1 0 0"/>'))
    np.testing.assert_array_equal(from_urdf(changed(GOOD, AXIS, "")).rotations, about_x.rotations)


def test_a_continuous_joint_has_no_position_limits():
    arm = from_urdf(changed(GOOD, ELBOW, ELBOW.replace("revolute", "continuous"), LIMIT, ""))
    assert np.isneginf(arm.limits.lower[1]) and np.isposinf(arm.limits.upper[1]) and np.isposinf(arm.limits.torque[1])
    arm = from_urdf(changed(GOOD, ELBOW, ELBOW.replace("revolute", "continuous")))
    assert np.isposinf(arm.limits.upper[1]) and arm.limits.torque[1] == 20.0


def test_invalid_limits_are_ignored_with_limits_false_and_for_locked_joints():
    arm = from_urdf(changed(GOOD, LIMIT, ""), limits=False)
    assert np.isposinf(arm.limits.torque).all() and np.isneginf(arm.limits.lower).all()
    for text in ("", limit(velocity="-7")):
        assert from_urdf(changed(GOOD, LIMIT, text), locked={"elbow": 0.3}).joints == 1


NOT_GIVEN = [
    ({"effort": "0"}, "no limit of effort for elbow", {"torque": np.inf}),
    ({"effort": None}, "no limit of effort for elbow", {"torque": np.inf}),
    ({"velocity": "0.0"}, "no limit of velocity for elbow", {"velocity": np.inf}),
    ({"velocity": None}, "no limit of velocity for elbow", {"velocity": np.inf}),
    ({"lower": None, "upper": None}, "no limit of position for elbow", {"lower": -np.inf, "upper": np.inf}),
    ({"lower": "0", "upper": "0"}, "no limit of position for elbow", {"lower": -np.inf, "upper": np.inf}),
    (
        {"effort": "0", "velocity": "0"},
        "no limit of velocity for elbow, no limit of effort for elbow",
        {"velocity": np.inf, "torque": np.inf},
    ),
]


@pytest.mark.parametrize(("values", "missing", "infinite"), NOT_GIVEN)
def test_a_missing_limit_is_infinite_and_the_others_are_read(values, missing, infinite):
    expected = {"lower": -1.0, "upper": 1.5, "velocity": 4.0, "torque": 20.0} | infinite
    with pytest.warns(DefinitionWarning) as caught:
        arm = from_urdf(changed(GOOD, LIMIT, limit(**values)))
    assert [str(warning.message) for warning in caught] == [
        f"arm: the file has {missing}, or a limit of 0; such limits are taken as infinite"
    ]
    for field, value in expected.items():
        assert float(getattr(arm.limits, field)[1]) == value
        assert float(getattr(arm.limits, field)[0]) == float(getattr(from_urdf(GOOD).limits, field)[0])


def test_one_warning_names_all_joints_without_a_limit_and_the_file(tmp_path):
    text = GOOD.replace('effort="50"', 'effort="0"').replace(LIMIT, "")
    (tmp_path / "arm.urdf").write_text(text)
    with pytest.warns(DefinitionWarning) as caught:
        from_urdf(tmp_path / "arm.urdf")
    (warning,) = caught
    assert str(warning.message).startswith(f"{tmp_path / 'arm.urdf'}: the file has ")
    for words in ("position for elbow,", "velocity for elbow,", "effort for shoulder, elbow,"):
        assert words in str(warning.message)


@pytest.mark.parametrize(("values", "ends"), [({"lower": None}, (0.0, 1.5)), ({"upper": None}, (-1.0, 0.0))])
def test_missing_lower_or_upper_limit_is_0_by_the_urdf_standard(values, ends):
    limits = from_urdf(changed(GOOD, LIMIT, limit(**values))).limits
    assert (float(limits.lower[1]), float(limits.upper[1])) == ends


@pytest.mark.parametrize("values", [{"lower": None, "upper": "-1"}, {"lower": "1", "upper": None}])
def test_single_limit_that_leaves_an_empty_range_is_refused(values):
    with pytest.raises(DefinitionError, match="`elbow` must have lower < upper"):
        from_urdf(changed(GOOD, LIMIT, limit(**values)))


def test_joint_that_mimics_a_locked_joint_is_held_with_it():
    text = changed(GOOD, LIMIT, LIMIT + MIMIC)
    with pytest.raises(DefinitionError, match=r"no joint that moves.*`elbow` mimics joint `shoulder`.*held at 1;"):
        from_urdf(text, locked={"shoulder": 0.25})


def test_armature_is_a_number_or_a_list_or_a_mapping_by_joint():
    np.testing.assert_array_equal(from_urdf(GOOD, armature=0.5).armature, [0.5, 0.5])
    np.testing.assert_array_equal(from_urdf(GOOD, armature=np.array([1.0, 2.0])).armature, [1.0, 2.0])
    np.testing.assert_array_equal(from_urdf(GOOD, armature={"elbow": 3.0}).armature, [0.0, 3.0])
    np.testing.assert_array_equal(from_urdf(GOOD, armature=[3.0], locked={"shoulder": 0.0}).armature, [3.0])


@pytest.mark.parametrize(
    ("armature", "named"),
    [([1.0], "shoulder, elbow"), ({"elbov": 1.0}, "did you mean `elbow`"), (-1.0, "armature of joint `shoulder`")],
)
def test_invalid_armatures_are_errors(armature, named):
    with pytest.raises(DefinitionError, match=named):
        from_urdf(GOOD, armature=armature)


def with_mesh(name: str) -> str:
    return changed(GOOD, FORE, f'{FORE}<visual><geometry><mesh filename="{name}"/></geometry></visual>')


def test_mesh_path_is_resolved_from_the_file_or_packages_without_reading_it(tmp_path):
    meshes = tmp_path / "arm_description" / "meshes"
    meshes.mkdir(parents=True)
    (meshes / "fore.dae").write_text("no mesh at all")
    path = tmp_path / "arm_description" / "arm.urdf"
    path.write_text(with_mesh("meshes/fore.dae"))
    assert from_urdf(path, meshes=True).joints == 2
    path.write_text(with_mesh("package://arm_description/meshes/fore.dae"))
    assert from_urdf(path, meshes=True).joints == 2
    text = path.read_text()
    for packages in ({"arm_description": meshes.parent}, [tmp_path / "empty", tmp_path]):
        assert from_urdf(text, packages=packages, meshes=True).joints == 2
    with pytest.raises(DefinitionError, match=r"empty/meshes/fore\.dae; packages=\{'arm_description': FOLDER\}"):
        from_urdf(text, packages={"arm_description": tmp_path / "empty"}, meshes=True)
    path.write_text(with_mesh(f"file://{meshes}/fore.dae"))
    assert from_urdf(path, meshes=True).joints == 2
    assert from_urdf(with_mesh("package://lost/fore.dae")).joints == 2


def test_default_tip_is_the_only_leaf_and_any_moving_link_can_be_the_tip():
    plate = '<joint name="to the plate" type="fixed"><parent link="base"/><child link="plate"/></joint>'
    arm = from_urdf(changed(GOOD, "</robot>", f'{plate}<link name="plate"/></robot>'))
    np.testing.assert_array_equal(arm.tip_translation, from_urdf(GOOD, tip="tool").tip_translation)
    arm = from_urdf(GOOD, tip="fore")
    np.testing.assert_allclose(np.linalg.norm(arm.tip(jnp.zeros(2)) - jnp.array([0.0, 0.0, 0.3])), 0.4, rtol=1e-14)
    with pytest.raises(DefinitionError, match="`base`, which is the base"):
        from_urdf(GOOD, tip="base")


def test_joints_are_in_the_order_of_the_tree_not_of_the_file():
    start, end = GOOD.index('<joint name="elbow"'), GOOD.index(TOOL)
    moved = GOOD[:start] + GOOD[end:]
    reordered = moved.replace('<link name="base"/>', '<link name="base"/>' + GOOD[start:end])
    assert from_urdf(reordered).joint_names == ("shoulder", "elbow")
    np.testing.assert_array_equal(from_urdf(reordered).masses, [2.0, 1.25])
