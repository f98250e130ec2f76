"""Arms from joints: invalid joints are refused, fixed links are merged, and each axis becomes the z axis."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from slidax.arms import Articulated, Joint, assemble
from slidax.core.errors import DefinitionError
from tests.arms.point_masses import body_of, points_of, seen_from
from tests.arms.trees import random_joint, tree_joints, turned

NAN, INF = float("nan"), float("inf")


def a_joint(**more) -> Joint:
    """A valid joint with some fields changed."""
    fields = {"name": "elbow", "kind": "revolute", "parent": None, "link": "forearm", "mass": 2.0}
    return Joint(**fields | {"inertia": np.diag([0.03, 0.04, 0.05])} | more)


BAD_JOINTS = {
    "negative mass": ({"mass": -1.0}, "the mass of link `forearm` must be >= 0 kg and finite; got -1"),
    "infinite mass": ({"mass": INF}, "the mass of link `forearm` must be >= 0 kg and finite"),
    "centre of mass": (
        {"center": np.array([0.0, NAN, 0.0])},
        "the centre of mass of link `forearm` must be three finite numbers",
    ),
    "centre of two numbers": (
        {"center": np.zeros(2)},
        r"the centre of mass of link `forearm` must be three finite numbers; got \[0.0, 0.0\]",
    ),
    "inertia of one number": ({"inertia": np.ones(3)}, "the inertia of link `forearm` must be 3 x 3 and finite"),
    "inertia that is no number": (
        {"inertia": np.full((3, 3), NAN)},
        "the inertia of link `forearm` must be 3 x 3 and finite",
    ),
    "inertia without mass": ({"mass": 0.0}, "link `forearm` has inertia but no mass; give it a mass > 0 kg"),
    "skew inertia": (
        {"inertia": np.diag([0.03, 0.04, 0.05]) + np.diag([0.01, 0.0], 1)},
        "the inertia of link `forearm` must be symmetric",
    ),
    "inertia of nothing": (
        {"inertia": np.zeros((3, 3))},
        "the inertia of link `forearm` must be positive definite; its principal moments are 0, 0, 0 kg m²",
    ),
    "negative inertia": (
        {"inertia": np.diag([-0.01, 0.02, 0.02])},
        "the inertia of link `forearm` must be positive definite; its principal moments are -0.01, 0.02, 0.02 kg m²",
    ),
    "negative inertia of a fixed link": (
        {"kind": "fixed", "inertia": np.diag([-0.01, 0.02, 0.02])},
        "the inertia of link `forearm` must be positive semi-definite",
    ),
    "inertia beyond the triangle": (
        {"inertia": np.diag([0.01, 0.02, 0.031])},
        "the inertia of link `forearm` is of no rigid body: the largest of its principal moments 0.01, 0.02, 0.031",
    ),
    "frame": ({"rotation": 2.0 * np.eye(3)}, "the frame of joint `elbow` must have orthonormal axes"),
    "frame that is no number": ({"rotation": np.full((3, 3), NAN)}, "the frame of joint `elbow` must have orthonormal"),
    "left-handed frame": (
        {"rotation": np.diag([1.0, 1.0, -1.0])},
        "the frame of joint `elbow` must have orthonormal axes, right-handed",
    ),
    "place": ({"translation": np.array([INF, 0.0, 0.0])}, "the position of joint `elbow` must be three finite numbers"),
    "no axis": ({"axis": np.zeros(3)}, r"the axis of joint `elbow` must have a direction; got \[0.0, 0.0, 0.0\]"),
    "axis that is no number": ({"axis": np.array([0.0, NAN, 1.0])}, "the axis of joint `elbow` must have a direction"),
    "axis of two numbers": ({"axis": np.ones(2)}, r"the axis of joint `elbow` must have a direction; got \[1.0, 1.0\]"),
    "limits": ({"lower": 1.0, "upper": -1.0}, "the limits of joint `elbow` must be lower < upper; got 1 and -1"),
    "limits that are no numbers": ({"lower": NAN}, "the limits of joint `elbow` must be lower < upper"),
    "velocity": ({"velocity": 0.0}, "the velocity limit of joint `elbow` must be > 0; got 0"),
    "torque": ({"torque": -5.0}, "the torque limit of joint `elbow` must be > 0; got -5"),
    "torque rate": ({"torque_rate": NAN}, "the torque rate limit of joint `elbow` must be > 0"),
    "armature": ({"armature": -0.1}, "the armature of joint `elbow` must be >= 0 and finite; got -0.1"),
    "viscous friction": ({"viscous": INF}, "the viscous friction of joint `elbow` must be >= 0 and finite; got inf"),
    "Coulomb friction": ({"coulomb": -1.0}, "the Coulomb friction of joint `elbow` must be >= 0 and finite; got -1"),
}

SHOULDER = a_joint(name="shoulder", link="upper arm")
ELBOW = a_joint(parent="shoulder", translation=np.array([0.4, 0.0, 0.0]))
FLANGE = Joint("flange", "fixed", "elbow", "tool")
ARM = [SHOULDER, ELBOW, FLANGE]
TIP = {"tip": "tool"}


def still(**more) -> Joint:
    """A joint whose link has no mass."""
    return a_joint(**{"mass": 0.0, "inertia": np.zeros((3, 3))} | more)


BAD_ARMS = {
    "no joints": ([], TIP, "arm has no joint that moves"),
    "nothing moves": ([Joint("flange", "fixed", None, "tool")], TIP, "arm has no joint that moves"),
    "two joints of one name": ([SHOULDER, a_joint(name="shoulder")], TIP, "there are two joints named `shoulder`"),
    "two joints of one link": (
        [SHOULDER, a_joint(link="upper arm")],
        TIP,
        "link `upper arm` is moved by two joints, `shoulder` and `elbow`",
    ),
    "unknown parent": (
        [SHOULDER, a_joint(parent="sholder"), FLANGE],
        TIP,
        "joint `elbow` has the parent joint `sholder`, which does not exist; did you mean `shoulder`?",
    ),
    "parent unlike any other": (
        [SHOULDER, a_joint(parent="x")],
        TIP,
        "joint `elbow` has the parent joint `x`, which does not exist; there are: `shoulder`, `elbow`",
    ),
    "circle": (
        [SHOULDER, a_joint(name="left", link="left link", parent="right"), a_joint(name="right", parent="left")],
        TIP,
        "the joints `left`, `right` carry each other in a circle; an arm is a tree",
    ),
    "unknown tip": (ARM, {"tip": "tol"}, "`tip` names link `tol`, which arm does not have; did you mean `tool`?"),
    "tip that stands still": (
        [Joint("stand", "fixed", None, "table"), SHOULDER],
        {"tip": "table"},
        "`tip` names link `table` of arm, which no joint moves",
    ),
    "unknown locked joint": (
        ARM,
        TIP | {"locked": {"elbo": 0.0}},
        "`locked` names `elbo`, which is no moving joint; did you mean `elbow`?",
    ),
    "locked joint that is fixed": (
        ARM,
        TIP | {"locked": {"flange": 0.0}},
        "`locked` names `flange`, which is no moving joint; there are: `shoulder`, `elbow`",
    ),
    "locked beyond its limits": (
        [SHOULDER, a_joint(parent="shoulder", lower=-1.0, upper=2.0), FLANGE],
        TIP | {"locked": {"elbow": 2.1}},
        "`locked` holds joint `elbow` at 2.1, which is outside its limits, -1 to 2",
    ),
    "locked nowhere": (
        ARM,
        TIP | {"locked": {"elbow": NAN}},
        "`locked` holds joint `elbow` at nan, which is outside its limits",
    ),
    "gravity of two numbers": (
        ARM,
        TIP | {"gravity": (0.0, -9.81)},
        r"`Articulated.gravity_vector` must be 3 numbers; got shape \[2\]",
    ),
    "nothing heavy at the end": (
        [SHOULDER, still(parent="shoulder"), FLANGE],
        TIP,
        "link `forearm` of arm, moved by joint `elbow`, has no mass, nor has anything that is fixed to it: "
        "give it mass and inertia, or lock the joint",
    ),
    "nothing heavy at all": (
        [still(name="shoulder", link="upper arm"), still(parent="shoulder"), FLANGE],
        TIP,
        "no moving link of arm has a mass, as in files that are only for drawing",
    ),
    "a point alone": (
        [SHOULDER, still(parent="shoulder"), Joint("flange", "fixed", "elbow", "tool", mass=1.0)],
        TIP,
        "the inertia of link `forearm`, with all that is fixed to it, must be positive definite",
    ),
    "two joints that move the same": (
        [still(name="shoulder", link="upper arm"), a_joint(parent="shoulder")],
        {"tip": "forearm"},
        "the inertia matrix of arm is singular: joint `(shoulder|elbow)` can move without moving any mass",
    ),
}


LOCKED = {"finger": 0.1}


@pytest.mark.parametrize(("changes", "message"), BAD_JOINTS.values(), ids=BAD_JOINTS)
def test_invalid_joints_are_errors_that_name_joint_or_link(changes, message):
    with pytest.raises(DefinitionError, match=message):
        a_joint(**changes)


def test_a_joint_of_an_unknown_kind_is_refused_by_its_name():
    joint = a_joint()
    # The type checker of the tests would refuse this kind in the constructor.
    object.__setattr__(joint, "kind", "continuous")
    message = "joint `elbow` must be `revolute`, `prismatic` or `fixed`; got `continuous`; a continuous joint is"
    with pytest.raises(DefinitionError, match=message):
        joint.__post_init__()


@pytest.mark.parametrize(("joints", "how", "message"), BAD_ARMS.values(), ids=BAD_ARMS)
def test_invalid_trees_of_joints_are_errors_that_name_them(joints, how, message):
    with pytest.raises(DefinitionError, match=message):
        assemble(joints, name="arm", **how)


def test_rounded_inertia_and_rotation_are_accepted():
    """A printed inertia may miss the triangle inequality in its last digit, and a frame its right angle."""
    rotation = np.array([[0.7071068, -0.7071068, 0.0], [0.7071068, 0.7071068, 0.0], [0.0, 0.0, 1.0]])
    a_joint(rotation=rotation, inertia=np.diag([0.01, 0.02, 0.03000001]))


def test_fixed_joints_need_no_axis_and_no_limits():
    assert Joint("flange", "fixed", None, "tool", axis=np.zeros(3), lower=0.0, upper=0.0, torque=0.0).mass == 0


def test_a_massless_link_is_accepted_between_heavy_links_or_with_an_armature():
    massless = still(name="shoulder", link="upper arm")
    elbow = a_joint(parent="shoulder", axis=np.array([0.0, 1.0, 0.0]), translation=np.array([0.4, 0.0, 0.0]))
    arm = assemble([massless, elbow], tip="forearm")
    np.testing.assert_array_equal(arm.masses, [0.0, 2.0])
    wheel = still(parent="shoulder", armature=0.2)
    np.testing.assert_array_equal(assemble([SHOULDER, wheel], tip="forearm").armature, [0.0, 0.2])


def test_point_masses_and_thin_rods_can_be_fixed_to_a_link():
    point = Joint("bolt", "fixed", "elbow", "bolt link", mass=0.5, center=np.array([0.1, 0.0, 0.0]))
    rod = Joint("rod", "fixed", "elbow", "rod link", mass=1.0, inertia=np.diag([0.0, 0.1, 0.1]))
    arm = assemble([a_joint(), point, rod], tip="forearm")
    np.testing.assert_allclose(arm.masses, [3.5])
    np.testing.assert_allclose(arm.centers, [[0.05 / 3.5, 0.0, 0.0]])
    across = 0.5 * 0.1**2 - 0.05**2 / 3.5
    np.testing.assert_allclose(arm.inertias, [np.diag([0.03, 0.14 + across, 0.15 + across])], atol=1e-17)


def test_assembled_arm_has_the_parameters_of_its_joints():
    numbers = {"lower": -0.5, "upper": 0.7, "velocity": 2.0, "torque": 9.0, "torque_rate": 800.0}
    rubbing = {"armature": 0.1, "viscous": 0.3, "coulomb": 0.4}
    slide = a_joint(name="slide", link="sledge", kind="prismatic", parent="elbow", axis=np.array([1.0, 0.0, 0.0]))
    gravity = (1.0, 2.0, -9.0)
    arm = assemble([a_joint(**numbers, **rubbing), slide], tip="sledge", gravity=gravity, name="crane")
    assert (arm.name, arm.joint_names, arm.link_names) == ("crane", ("elbow", "slide"), ("forearm", "sledge"))
    assert (arm.joint_units, arm.parents, arm.tip_joint) == (("rad", "m"), (-1, 0), 1)
    for field, value in numbers.items():
        none = {"lower": -np.inf}.get(field, np.inf)
        np.testing.assert_array_equal(getattr(arm.limits, field), [value, none])
    for field, value in rubbing.items():
        np.testing.assert_array_equal(getattr(arm, field), [value, 0.0])
    np.testing.assert_array_equal(arm.gravity_vector, gravity)
    assert float(arm.payload.mass) == 0.0


def test_a_link_without_fixed_parts_keeps_its_parameters_bit_for_bit():
    skew = np.array([[0.7, 0.1, -0.2], [0.1, 0.7, 0.3], [-0.2, 0.3, 0.7]])
    elbow = a_joint(mass=0.646926, center=np.array([-0.003141, -0.02872, 0.003495]), inertia=skew)
    arm = assemble([elbow, FLANGE], **TIP)
    np.testing.assert_array_equal(arm.centers, [elbow.center])
    np.testing.assert_array_equal(arm.inertias, [skew])


def test_joints_keep_their_order_unless_a_child_precedes_its_parent():
    names = ["wrist", "waist", "finger", "left", "lift", "camera", "right", "mount"]
    by_name = {joint.name: joint for joint in tree_joints()}
    arm = assemble([by_name[name] for name in names], tip="camera_link")
    assert arm.joint_names == ("waist", "lift", "left", "wrist", "finger", "right")
    assert arm.parents == (-1, 0, 1, 2, 3, 1)
    assert assemble(tree_joints(), tip="camera_link").joint_names == (
        *("waist", "lift", "left", "right", "wrist", "finger"),
    )


def at_zero(arm: Articulated) -> list[tuple[np.ndarray, np.ndarray]]:
    """Every joint's frame in the base frame, at zero positions."""
    frames: list[tuple[np.ndarray, np.ndarray]] = []
    for i, parent in enumerate(arm.parents):
        rotation, place = frames[parent] if parent >= 0 else (np.eye(3), np.zeros(3))
        frames.append((rotation @ np.asarray(arm.rotations[i]), place + rotation @ np.asarray(arm.translations[i])))
    return frames


def described_at_zero(joints: list[Joint], sliding: dict[str, float]) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Every link's frame in the base frame, by the name of its joint; a locked joint is prismatic and at `sliding`."""
    frames: dict[str | None, tuple[np.ndarray, np.ndarray]] = {None: (np.eye(3), np.zeros(3))}
    for joint in joints:
        rotation, place = frames[joint.parent]
        way = sliding.get(joint.name, 0.0) * joint.axis / np.linalg.norm(joint.axis)
        turned_so = rotation @ joint.rotation
        frames[joint.name] = turned_so, place + rotation @ joint.translation + turned_so @ way
    return {name: frame for name, frame in frames.items() if name is not None}


def test_z_axis_of_each_joint_frame_is_the_described_joint_axis():
    joints = tree_joints()
    arm, described = assemble(joints, tip="camera_link"), described_at_zero(joints, {})
    for (rotation, place), name in zip(at_zero(arm), arm.joint_names, strict=True):
        axis = next(joint.axis for joint in joints if joint.name == name)
        np.testing.assert_allclose(rotation[:, 2], described[name][0] @ axis / np.linalg.norm(axis), atol=1e-14)
        np.testing.assert_allclose(place, described[name][1], atol=1e-14)
        np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-14)
        assert np.linalg.det(rotation) > 0


@pytest.mark.parametrize("axis", [[0.0, 0.0, 2.0], [0.0, 0.0, -1.0], [1e-9, 0.0, 1.0], [0.0, -3.0, 0.0]])
def test_joint_axis_near_a_coordinate_axis_keeps_its_precision(axis):
    rotation = turned(np.random.default_rng(4))
    arm = assemble([a_joint(axis=np.array(axis), rotation=rotation)], tip="forearm")
    np.testing.assert_allclose(arm.rotations[0] @ np.array([0.0, 0.0, 1.0]), rotation @ axis / np.linalg.norm(axis))
    np.testing.assert_allclose(arm.rotations[0].T @ arm.rotations[0], np.eye(3), atol=1e-15)
    if axis[2] == 2.0:
        np.testing.assert_array_equal(arm.rotations[0], rotation)


def merged_by_hand(joints: list[Joint], locked: dict[str, float]) -> dict[str, tuple[float, np.ndarray, np.ndarray]]:
    """Mass, centre and inertia of each joint's own links, in the base frame, at zero positions."""
    frames, carriers = described_at_zero(joints, locked), {}
    parts: dict[str, list[tuple[np.ndarray, np.ndarray]]] = {}
    for joint in joints:
        stays = joint.kind == "fixed" or joint.name in locked
        carriers[joint.name] = carriers.get(joint.parent) if stays else joint.name
        if carriers[joint.name] is not None:
            points = points_of(joint.mass, joint.center, joint.inertia)
            parts.setdefault(carriers[joint.name], []).append(seen_from(*frames[joint.name], points))
    return {name: body_of(*bodies) for name, bodies in parts.items()}


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_links_behind_fixed_or_locked_joints_merge_into_their_moving_parent(seed):
    rng = np.random.default_rng(100 + seed)
    tool = random_joint(rng, "tool", "camera", "fixed")
    stand = random_joint(rng, "stand", None, "fixed", mass=50.0)
    joints = [stand, *tree_joints(seed), tool]
    joints[1] = replace(joints[1], parent="stand")
    arm = assemble(joints, tip="tool_link", locked=LOCKED)
    expected = merged_by_hand(joints, LOCKED)
    assert arm.joint_names == ("waist", "lift", "left", "right", "wrist")
    for i, (rotation, place) in enumerate(at_zero(arm)):
        mass, center, inertia = expected[arm.joint_names[i]]
        np.testing.assert_allclose(arm.masses[i], mass, rtol=1e-14)
        np.testing.assert_allclose(place + rotation @ arm.centers[i], center, atol=1e-14)
        np.testing.assert_allclose(rotation @ arm.inertias[i] @ rotation.T, inertia, atol=1e-14)
    rotation, place = at_zero(arm)[arm.tip_joint]
    tip = described_at_zero(joints, LOCKED)["tool"]
    np.testing.assert_allclose(rotation @ arm.tip_rotation, tip[0], atol=1e-14)
    np.testing.assert_allclose(place + rotation @ arm.tip_translation, tip[1], atol=1e-14)


def test_locked_joints_stay_at_their_position():
    """A quarter turn moves the centre of mass from the x axis to the y axis."""
    elbow = a_joint(parent="shoulder", center=np.array([0.3, 0.0, 0.0]), translation=np.array([0.4, 0.0, 0.0]))
    arm = assemble(
        [replace(SHOULDER, mass=0.0, inertia=np.zeros((3, 3))), elbow, FLANGE], **TIP, locked={"elbow": np.pi / 2}
    )
    np.testing.assert_allclose(arm.centers, [[0.4, 0.3, 0.0]], atol=1e-15)
    np.testing.assert_allclose(arm.inertias, [np.diag([0.04, 0.03, 0.05])], atol=1e-16)
    np.testing.assert_allclose(arm.tip_rotation, [[0, -1, 0], [1, 0, 0], [0, 0, 1]], atol=1e-15)
    assert arm.joint_names == ("shoulder",)


# The other seeds differ in their numbers only.
@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=pytest.mark.full) for seed in (1, 2))])
def test_random_tree_with_skew_axes_agrees_with_pinocchio(seed):
    pytest.importorskip("pinocchio")
    from tests.peers.assembled import for_pinocchio
    from tests.peers.by_pinocchio import by_pinocchio
    from tests.peers.motion import assert_same, by_slidax, random_states

    locked, joints = LOCKED | {"left": -0.7}, tree_joints(seed)
    arm = assemble(joints, tip="camera_link", locked=locked)
    states = random_states(arm, 100)
    theirs = by_pinocchio(for_pinocchio(joints, locked), "camera_link", arm.joint_names, states)
    assert_same(by_slidax(arm, states), theirs)
