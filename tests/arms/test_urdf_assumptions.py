"""URDF files with harmless faults: the file is read, and a warning names file, element and remedy."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from slidax.arms import from_urdf
from slidax.core.errors import DefinitionError, DefinitionWarning
from tests.arms.bad_file import changed
from tests.arms.bad_urdf import (
    AXIS,
    CENTER,
    END,
    GOOD,
    INERTIA,
    LIMIT,
    MASS,
    ORIGIN,
    SPARE,
    TOOL,
    inertia,
    joint,
    limit,
)

pytest.importorskip("mujoco")
HAND = (
    SPARE.replace("spare", "left")
    + SPARE.replace("spare", "right")
    + joint("prismatic", "finger1", "tool", "left", '<axis xyz="0 1 0"/><limit lower="0.01" upper="0.04"/>')
    + joint(
        "prismatic",
        "finger2",
        "tool",
        "right",
        '<axis xyz="0 1 0"/><limit lower="-0.04" upper="-0.01"/>'
        '<mimic joint="finger1" multiplier="-1" offset="0.005"/>',
    )
)
FLANGE = '<child link="tool"/>'
TIP = joint("fixed", "to tip", "tool", "tcp") + '<link name="tcp"/>'
GRIPPED = changed(GOOD, END, HAND + TIP + END)
CYLINDER = changed(
    GOOD,
    END,
    SPARE + joint("revolute", "cylinder", "upper", "spare", '<mimic joint="shoulder" multiplier="-0.5"/>') + END,
)
ON_A_WORLD = changed(GOOD, '<link name="base"/>', "").replace('link="base"', 'link="world"')

READ = {
    "an attribute of no meaning in the inertia": (INERTIA, INERTIA.replace("iyy", 'iyx="0" iyy'), ["`iyx`", "`fore`"]),
    "an attribute that is like no other": (AXIS, '<axis xyz="0 1 0" rpy="0 0 0"/>', ["`rpy` in <axis>", "`elbow`"]),
    "an element that is like a known one": (END, '<RefLink ref="fore"/>' + END, ["<RefLink>", "the robot"]),
    "an axis without numbers in a fixed joint": (FLANGE, FLANGE + "<axis/>", ["<axis>", "`flange`", "fixed"]),
    "an axis of words in a fixed joint": (FLANGE, FLANGE + '<axis xyz="a b c"/>', ["<axis>", "`flange`", "`a`"]),
    "a limit of words in a fixed joint": (FLANGE, FLANGE + '<limit effort="x"/>', ["<limit>", "`flange`"]),
    "a link that is there twice": (TOOL, TOOL + TOOL, ["link `tool` occurs twice", "remove"]),
    "a prefix that nothing declares": (END, "<gazebo><a:b/></gazebo>" + END, ["<a:b>", "xmlns:a"]),
}


@pytest.mark.parametrize(("old", "new", "words"), READ.values(), ids=READ)
def test_harmless_file_fault_causes_one_warning_and_leaves_the_arm_unchanged(old, new, words, tmp_path):
    path = tmp_path / "my.urdf"
    path.write_text(changed(GOOD, old, new))
    with pytest.warns(DefinitionWarning) as caught:
        arm = from_urdf(path)
    (warning,) = caught
    message = str(warning.message)
    assert message.startswith(f"{path}: ")
    assert not [word for word in words if word not in message], message
    good = from_urdf(GOOD)
    for field in ("inertias", "masses", "centers", "rotations", "translations", "tip_translation"):
        np.testing.assert_array_equal(getattr(arm, field), getattr(good, field))


def test_one_warning_lists_all_owners_of_a_fault():
    text = GOOD.replace("/>\n    <limit", ' rpy="0 0 0"/>\n    <limit')
    with pytest.warns(DefinitionWarning) as caught:
        from_urdf(text)
    assert [str(warning.message) for warning in caught] == [
        "arm: `rpy` in <axis> of joint `shoulder` and joint `elbow` is not read, as URDF has no such attribute; "
        "remove it"
    ]


@pytest.mark.parametrize(("velocity", "effort"), [("-1", "20"), ("4", "-1"), ("-1.0", "-1")])
def test_a_limit_of_minus_1_counts_as_missing(velocity, effort):
    with pytest.warns(DefinitionWarning) as caught:
        arm = from_urdf(changed(GOOD, LIMIT, limit(velocity=velocity, effort=effort)))
    assert float(arm.limits.velocity[1]) == (np.inf if velocity.startswith("-") else 4.0)
    assert float(arm.limits.torque[1]) == (np.inf if effort == "-1" else 20.0)
    told = " ".join(str(warning.message) for warning in caught)
    assert "-1 in <limit> of joint `elbow` counts as missing" in told


def test_exchanged_lower_and_upper_limits_around_0_are_corrected():
    with pytest.warns(
        DefinitionWarning, match="`elbow` has lower 1.5 > upper -1: they are read as exchanged, -1 to 1.5"
    ):
        arm = from_urdf(changed(GOOD, LIMIT, limit(lower="1.5", upper="-1")))
    assert (float(arm.limits.lower[1]), float(arm.limits.upper[1])) == (-1.0, 1.5)


def test_a_range_of_one_position_is_refused_with_a_remedy_that_works():
    text = changed(GOOD, LIMIT, limit(lower="1.5", upper="1.5"))
    with pytest.raises(DefinitionError, match=r"locked=\{'elbow': 1.5\} holds"):
        from_urdf(text)
    assert from_urdf(text, locked={"elbow": 1.5}).joint_names == ("shoulder",)


def test_undeclared_parent_link_becomes_the_base_with_a_warning():
    with pytest.warns(
        DefinitionWarning, match='link `world`, the parent of joint `shoulder`.* write <link name="world"/>'
    ):
        arm = from_urdf(ON_A_WORLD)
    np.testing.assert_array_equal(arm.inertias, from_urdf(GOOD).inertias)


@pytest.mark.parametrize("length", [1.0, 2.0])
@pytest.mark.parametrize("angles", [(0.3, -1.2, 2.5), (0.0, np.pi / 2, 0.0)], ids=["any", "straight up"])
def test_quaternion_of_any_length_in_an_origin_equals_the_same_roll_pitch_yaw_angles(angles, length):
    rotation = length * Rotation.from_euler("xyz", angles).as_quat()
    words, quaternion = (" ".join(repr(float(x)) for x in row) for row in (angles, rotation))
    expected = from_urdf(changed(GOOD, ORIGIN, f'<origin xyz="0.4 0 0" rpy="{words}"/>'))
    turned = from_urdf(changed(GOOD, ORIGIN, f'<origin xyz="0.4 0 0" quat_xyzw="{quaternion}"/>'))
    np.testing.assert_allclose(turned.rotations, expected.rotations, rtol=0, atol=1e-14)


@pytest.mark.parametrize("moment", ["-4e-22", "0", "4e-22"])
def test_a_thin_rod_is_accepted_and_a_moment_rounded_below_0_is_0(moment):
    arm = from_urdf(changed(GOOD, INERTIA, inertia(moment, "0.0125", "0.0125")))
    np.testing.assert_allclose(np.linalg.eigvalsh(arm.inertias[1]), [0.0, 0.0125, 0.0125], rtol=0, atol=1e-15)


def test_negative_moment_is_judged_relative_to_the_links_own_moments():
    small = changed(GOOD, INERTIA, inertia("-4e-13", "5e-13", "5e-13"))
    with pytest.raises(DefinitionError, match=r"link `fore` must be positive definite.*inertias=\"nearest\""):
        from_urdf(small)


def test_coupled_fingers_are_held_and_the_warning_names_their_positions():
    with pytest.warns(DefinitionWarning) as caught:
        arm = from_urdf(GRIPPED, tip="tcp", limits=False)
    assert arm.joint_names == ("shoulder", "elbow")
    (warning,) = caught
    message = str(warning.message)
    assert "joint `finger1` leads `finger2`, which is not between the base and the tip `tcp`" in message
    assert "locked={'finger1': 0.01, 'finger2': -0.005} is assumed" in message
    held = from_urdf(GRIPPED, tip="tcp", limits=False, locked={"finger1": 0.01, "finger2": -0.005})
    np.testing.assert_array_equal(arm.inertias, held.inertias)


def test_finger_that_mimics_a_locked_finger_is_held_at_its_ratio():
    with pytest.warns(
        DefinitionWarning, match="joint `finger2` mimics joint `finger1`, which does not move: .* -0.025"
    ):
        arm = from_urdf(GRIPPED, tip="tcp", limits=False, locked={"finger1": 0.03})
    held = from_urdf(GRIPPED, tip="tcp", limits=False, locked={"finger1": 0.03, "finger2": -0.025})
    np.testing.assert_allclose(arm.inertias, held.inertias, rtol=1e-14, atol=1e-16)


def test_follower_outside_the_arm_is_held_and_its_leader_moves():
    with pytest.warns(DefinitionWarning, match=r"`shoulder` leads `cylinder`.*locked=\{'cylinder': 0\} is assumed"):
        arm = from_urdf(CYLINDER, tip="tool", limits=False)
    assert arm.joint_names == ("shoulder", "elbow")


@pytest.mark.parametrize("leader", ["nobody", "cylinder"])
def test_joint_outside_the_arm_with_an_invalid_mimic_is_held(leader):
    with pytest.warns(DefinitionWarning, match=r"`cylinder` is held at 0; locked=\{'cylinder': POSITION\}"):
        arm = from_urdf(CYLINDER.replace('joint="shoulder"', f'joint="{leader}"'), tip="tool", limits=False)
    assert arm.joint_names == ("shoulder", "elbow")


def test_a_joint_that_mimics_a_fixed_joint_is_held_at_its_offset():
    with pytest.warns(
        DefinitionWarning, match="`cylinder` mimics joint `flange`, which does not move: it is held at 0.2"
    ):
        arm = from_urdf(
            CYLINDER.replace('joint="shoulder" multiplier="-0.5"', 'joint="flange" offset="0.2"'),
            tip="tool",
            limits=False,
        )
    held = from_urdf(CYLINDER, tip="tool", limits=False, locked={"cylinder": 0.2})
    np.testing.assert_allclose(arm.inertias, held.inertias, rtol=1e-14, atol=1e-16)


def test_error_includes_the_notes_on_the_elements_that_it_names():
    text = changed(
        GOOD, END, '<RefLink ref="fore"/>' + END, CENTER, CENTER + '<Mass value="2"/>', MASS, '<mass value="-1"/>'
    )
    with pytest.raises(DefinitionError, match=r"the mass of link `fore` must be >= 0.*; note that <Mass> in") as caught:
        from_urdf(text)
    assert "RefLink" not in str(caught.value)


def test_a_joint_of_the_arm_that_mimics_itself_is_refused_with_a_remedy():
    with pytest.raises(DefinitionError, match=r"`elbow`, which follows it in turn; locked=\{'elbow': 0\} holds"):
        from_urdf(changed(GOOD, LIMIT, LIMIT + '<mimic joint="elbow"/>'))
