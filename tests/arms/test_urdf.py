"""Arms from URDF files."""

from __future__ import annotations

from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from slidax.arms import from_urdf
from slidax.core.errors import DefinitionError, DefinitionWarning
from tests.arms.bad_file import changed
from tests.arms.bad_urdf import AXIS, ELBOW, FORE, GOOD, INERTIA, LIMIT, ORIGIN, TOOL, limit
from tests.paper_examples import SCARA, TWO_LINK

pytest.importorskip("mujoco")
EXAMPLES = Path(__file__).parents[2] / "examples" / "robots"
STATES = np.random.default_rng(3).uniform(-3.0, 3.0, (2, 50, 3))
PAPER = [
    pytest.param("two_link.urdf", {"gravity": (0.0, -9.8, 0.0), "armature": [5.0, 5.0]}, TWO_LINK, id="two-link"),
    pytest.param("scara.urdf", {"gravity": (0.0, 0.0, -9.8)}, SCARA, id="SCARA", marks=pytest.mark.full),
]
MIMIC = '<mimic joint="shoulder" multiplier="2" offset="0.5"/>'


@pytest.mark.parametrize(("file", "arguments", "printed"), PAPER)
def test_paper_arms_agree_with_their_urdf(file, arguments, printed):
    arm = from_urdf(EXAMPLES / file, **arguments)
    assert arm.joint_units == printed.joint_units
    q, dq = STATES[:, :, : printed.joints]

    def motion(robot, q, dq):
        return robot.mass(q), robot.bias(q, dq), robot.tip(q), robot.potential(q) - robot.potential(jnp.zeros_like(q))

    motions = jax.jit(jax.vmap(motion, (None, 0, 0)))
    for one, other in zip(motions(arm, q, dq), motions(printed, q, dq), strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-12, atol=1e-12)


def test_arm_has_the_numbers_of_the_file():
    arm = from_urdf(GOOD)
    assert arm.name == "arm"
    assert arm.joint_names == ("shoulder", "elbow")
    assert arm.link_names == ("upper", "fore")
    np.testing.assert_array_equal(arm.limits.lower, [-2.0, -1.0])
    np.testing.assert_array_equal(arm.limits.upper, [2.5, 1.5])
    np.testing.assert_array_equal(arm.limits.torque, [50.0, 20.0])
    np.testing.assert_array_equal(arm.limits.velocity, [3.0, 4.0])
    np.testing.assert_array_equal(arm.viscous, [0.5, 0.0])
    np.testing.assert_array_equal(arm.coulomb, [0.25, 0.0])
    np.testing.assert_array_equal(arm.masses, [2.0, 1.25])
    np.testing.assert_array_equal(arm.armature, [0.0, 0.0])
    np.testing.assert_allclose(arm.gravity_vector, [0.0, 0.0, -9.81])
    # The inertia of the upper arm is about axes that are turned by .3 rad about x.
    turn = np.array([[1.0, 0.0, 0.0], [0.0, np.cos(0.3), -np.sin(0.3)], [0.0, np.sin(0.3), np.cos(0.3)]])
    inertia = np.array([[0.02, 0.001, 0.0], [0.001, 0.03, 0.0], [0.0, 0.0, 0.04]])
    np.testing.assert_allclose(arm.inertias[0], turn @ inertia @ turn.T, rtol=1e-13, atol=1e-16)
    # The shoulder's own rotation of (0.1, 0.2, 0.3) about fixed axes, of a point 0.6 m along x.
    cosine, sine = np.cos([0.1, 0.2, 0.3]), np.sin([0.1, 0.2, 0.3])
    along_x = [cosine[1] * cosine[2], cosine[1] * sine[2], -sine[1]]
    np.testing.assert_allclose(arm.tip(jnp.zeros(2)), 0.6 * np.array(along_x) + [0.0, 0.0, 0.3], rtol=1e-14)


def test_a_path_a_text_and_a_file_in_another_encoding_are_the_same_arm(tmp_path):
    (tmp_path / "arm.urdf").write_text(GOOD)
    (tmp_path / "wide.urdf").write_bytes(GOOD.replace("utf-8", "utf-16").encode("utf-16"))
    for source in (tmp_path / "arm.urdf", str(tmp_path / "arm.urdf"), tmp_path / "wide.urdf", "\ufeff" + GOOD):
        np.testing.assert_array_equal(from_urdf(source).inertias, from_urdf(GOOD).inertias)


def test_the_length_of_an_axis_does_not_matter():
    longer, unit = from_urdf(changed(GOOD, AXIS, '<axis xyz="0 2.5 0"/>')), from_urdf(GOOD)
    np.testing.assert_allclose(longer.rotations, unit.rotations, rtol=1e-14, atol=1e-14)
    np.testing.assert_allclose(longer.inertias, unit.inertias, rtol=1e-14, atol=1e-14)


def test_without_an_axis_a_joint_turns_about_x():
    given = from_urdf(changed(GOOD, AXIS, '<axis xyz="1 0 0"/>'))
    np.testing.assert_array_equal(from_urdf(changed(GOOD, AXIS, "")).rotations, given.rotations)


def test_a_continuous_joint_needs_no_limits_and_has_no_ends():
    arm = from_urdf(changed(GOOD, ELBOW, ELBOW.replace("revolute", "continuous"), LIMIT, ""))
    assert np.isneginf(arm.limits.lower[1]) and np.isposinf(arm.limits.upper[1]) and np.isposinf(arm.limits.torque[1])
    arm = from_urdf(changed(GOOD, ELBOW, ELBOW.replace("revolute", "continuous")))
    assert np.isposinf(arm.limits.upper[1]) and arm.limits.torque[1] == 20.0


def test_limits_need_not_be_read():
    arm = from_urdf(changed(GOOD, LIMIT, ""), limits=False)
    assert np.isposinf(arm.limits.torque).all() and np.isneginf(arm.limits.lower).all()


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


@pytest.mark.parametrize(("values", "said", "infinite"), NOT_GIVEN)
def test_a_limit_that_is_not_given_is_infinite_and_the_others_are_read(values, said, infinite):
    expected = {"lower": -1.0, "upper": 1.5, "velocity": 4.0, "torque": 20.0} | infinite
    with pytest.warns(DefinitionWarning) as caught:
        arm = from_urdf(changed(GOOD, LIMIT, limit(**values)))
    assert [str(warning.message) for warning in caught] == [
        f"arm: the file gives {said}, or 0 for it; it is taken as infinite"
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
    assert str(warning.message).startswith(f"{tmp_path / 'arm.urdf'}: the file gives ")
    for words in ("position for elbow,", "velocity for elbow,", "effort for shoulder, elbow,"):
        assert words in str(warning.message)


def test_limits_of_a_locked_joint_are_ignored():
    assert from_urdf(changed(GOOD, LIMIT, ""), locked={"elbow": 0.3}).joints == 1


@pytest.mark.parametrize(("values", "ends"), [({"lower": None}, (0.0, 1.5)), ({"upper": None}, (-1.0, 0.0))])
def test_one_end_alone_has_the_other_at_0_as_the_standard_says(values, ends):
    limits = from_urdf(changed(GOOD, LIMIT, limit(**values))).limits
    assert (float(limits.lower[1]), float(limits.upper[1])) == ends


@pytest.mark.parametrize("values", [{"lower": None, "upper": "-1"}, {"lower": "1", "upper": None}])
def test_one_end_alone_beyond_0_is_refused(values):
    with pytest.raises(DefinitionError, match="`elbow` must have lower < upper"):
        from_urdf(changed(GOOD, LIMIT, limit(**values)))


def test_a_joint_that_mimics_a_locked_one_is_held_with_it():
    text = changed(GOOD, LIMIT, LIMIT + MIMIC)
    assert from_urdf(text, locked={"elbow": 0.5}).joint_names == ("shoulder",)
    with pytest.raises(DefinitionError, match=r"no joint that moves.*`elbow` mimics joint `shoulder`.*held at 1;"):
        from_urdf(text, locked={"shoulder": 0.25})


def test_armature_is_one_number_or_one_for_each_joint_or_by_name():
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


def test_links_fixed_to_the_base_may_have_any_mass():
    mount = GOOD.replace('<parent link="base"/>', '<parent link="mount"/>').replace(
        '<link name="base"/>',
        '<link name="base"/><joint name="bolts" type="fixed"><parent link="base"/><child link="mount"/></joint>'
        '<link name="mount"><inertial><mass value="-1"/>' + INERTIA + "</inertial></link>",
    )
    np.testing.assert_array_equal(from_urdf(mount).masses, [2.0, 1.25])


def test_a_link_named_world_is_a_link_as_any_other():
    named = GOOD.replace('"upper"', '"world"')
    np.testing.assert_array_equal(from_urdf(named).inertias, from_urdf(GOOD).inertias)


def test_elements_of_other_programs_are_ignored():
    more = changed(
        GOOD,
        "</robot>",
        '<gazebo reference="fore"><mu1>nan</mu1></gazebo><mujoco><compiler inertiafromgeom="true"/></mujoco></robot>',
        ORIGIN,
        ORIGIN + "<hardware_interface/>",
    )
    np.testing.assert_array_equal(from_urdf(more).inertias, from_urdf(GOOD).inertias)


def with_mesh(name: str) -> str:
    return changed(GOOD, FORE, f'{FORE}<visual><geometry><mesh filename="{name}"/></geometry></visual>')


def test_a_mesh_is_found_beside_the_file_and_in_packages_and_is_not_read(tmp_path):
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


def test_missing_mesh_is_no_error_by_default():
    assert from_urdf(with_mesh("package://lost/fore.dae")).joints == 2


def test_the_tip_is_the_only_link_that_moves_and_carries_none():
    beside = '<joint name="to the plate" type="fixed"><parent link="base"/><child link="plate"/></joint>'
    arm = from_urdf(changed(GOOD, "</robot>", f'{beside}<link name="plate"/></robot>'))
    np.testing.assert_array_equal(arm.tip_translation, from_urdf(GOOD, tip="tool").tip_translation)


def test_the_tip_may_be_any_link_that_moves():
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
