"""From joints to an arm: what cannot be is refused, what is fixed is merged, and each axis is turned onto z."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from slidax.arms import Articulated, Joint, assemble
from slidax.core.errors import DefinitionError
from tests.arms.bad_arms import BAD_ARMS, BAD_JOINTS, FLANGE, SHOULDER, TIP, a_joint, still
from tests.arms.point_masses import body_of, points_of, seen_from
from tests.arms.trees import random_joint, tree_joints, turned

LOCKED = {"finger": 0.1}


@pytest.mark.parametrize(("changes", "said"), BAD_JOINTS.values(), ids=BAD_JOINTS)
def test_invalid_joints_are_errors_that_name_joint_or_link(changes, said):
    with pytest.raises(DefinitionError, match=said):
        a_joint(**changes)


def test_a_joint_of_an_unknown_kind_is_refused_by_its_name():
    joint = a_joint()
    # What checks types in these tests would be first.
    object.__setattr__(joint, "kind", "continuous")
    said = "joint `elbow` must be `revolute`, `prismatic` or `fixed`; got `continuous`; one that turns without end is"
    with pytest.raises(DefinitionError, match=said):
        joint.__post_init__()


@pytest.mark.parametrize(("joints", "how", "said"), BAD_ARMS.values(), ids=BAD_ARMS)
def test_invalid_trees_of_joints_are_errors_that_name_them(joints, how, said):
    with pytest.raises(DefinitionError, match=said):
        assemble(joints, name="arm", **how)


def test_rounded_numbers_pass():
    """A printed inertia may miss the triangle inequality in its last digit, and a frame its right angle."""
    rotation = np.array([[0.7071068, -0.7071068, 0.0], [0.7071068, 0.7071068, 0.0], [0.0, 0.0, 1.0]])
    a_joint(rotation=rotation, inertia=np.diag([0.01, 0.02, 0.03000001]))


def test_fixed_joints_need_no_axis_and_no_limits():
    assert Joint("flange", "fixed", None, "tool", axis=np.zeros(3), lower=0.0, upper=0.0, torque=0.0).mass == 0


def test_a_link_without_mass_is_taken_between_heavy_ones_or_with_an_armature():
    massless = still(name="shoulder", link="upper arm")
    elbow = a_joint(parent="shoulder", axis=np.array([0.0, 1.0, 0.0]), translation=np.array([0.4, 0.0, 0.0]))
    arm = assemble([massless, elbow], tip="forearm")
    np.testing.assert_array_equal(arm.masses, [0.0, 2.0])
    wheel = still(parent="shoulder", armature=0.2)
    np.testing.assert_array_equal(assemble([SHOULDER, wheel], tip="forearm").armature, [0.0, 0.2])


def test_points_and_thin_rods_can_be_fixed_to_a_link():
    point = Joint("bolt", "fixed", "elbow", "bolt link", mass=0.5, center=np.array([0.1, 0.0, 0.0]))
    rod = Joint("rod", "fixed", "elbow", "rod link", mass=1.0, inertia=np.diag([0.0, 0.1, 0.1]))
    arm = assemble([a_joint(), point, rod], tip="forearm")
    np.testing.assert_allclose(arm.masses, [3.5])
    np.testing.assert_allclose(arm.centers, [[0.05 / 3.5, 0.0, 0.0]])
    across = 0.5 * 0.1**2 - 0.05**2 / 3.5
    np.testing.assert_allclose(arm.inertias, [np.diag([0.03, 0.14 + across, 0.15 + across])], atol=1e-17)


def test_assembled_arm_has_the_numbers_of_its_joints():
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


def test_a_link_with_nothing_fixed_to_it_keeps_its_numbers_to_the_last_digit():
    skew = np.array([[0.7, 0.1, -0.2], [0.1, 0.7, 0.3], [-0.2, 0.3, 0.7]])
    elbow = a_joint(mass=0.646926, center=np.array([-0.003141, -0.02872, 0.003495]), inertia=skew)
    arm = assemble([elbow, FLANGE], **TIP)
    np.testing.assert_array_equal(arm.centers, [elbow.center])
    np.testing.assert_array_equal(arm.inertias, [skew])


def test_joints_keep_their_order_except_before_their_parents():
    names = ["wrist", "waist", "finger", "left", "lift", "camera", "right", "mount"]
    by_name = {joint.name: joint for joint in tree_joints()}
    arm = assemble([by_name[name] for name in names], tip="camera_link")
    assert arm.joint_names == ("waist", "lift", "left", "wrist", "finger", "right")
    assert arm.parents == (-1, 0, 1, 2, 3, 1)
    assert assemble(tree_joints(), tip="camera_link").joint_names == (
        *("waist", "lift", "left", "right", "wrist", "finger"),
    )


def at_zero(arm: Articulated) -> list[tuple[np.ndarray, np.ndarray]]:
    """Every joint's frame in the base's, where all positions are 0."""
    found: list[tuple[np.ndarray, np.ndarray]] = []
    for i, parent in enumerate(arm.parents):
        rotation, place = found[parent] if parent >= 0 else (np.eye(3), np.zeros(3))
        found.append((rotation @ np.asarray(arm.rotations[i]), place + rotation @ np.asarray(arm.translations[i])))
    return found


def described_at_zero(joints: list[Joint], sliding: dict[str, float]) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Every link's frame in the base's, by the name of its joint; what is locked slides."""
    found: dict[str | None, tuple[np.ndarray, np.ndarray]] = {None: (np.eye(3), np.zeros(3))}
    for joint in joints:
        rotation, place = found[joint.parent]
        way = sliding.get(joint.name, 0.0) * joint.axis / np.linalg.norm(joint.axis)
        turned_so = rotation @ joint.rotation
        found[joint.name] = turned_so, place + rotation @ joint.translation + turned_so @ way
    return {name: frame for name, frame in found.items() if name is not None}


def test_each_joint_turns_about_the_z_axis_of_its_frame_where_its_axis_was():
    joints = tree_joints()
    arm, described = assemble(joints, tip="camera_link"), described_at_zero(joints, {})
    for (rotation, place), name in zip(at_zero(arm), arm.joint_names, strict=True):
        axis = next(joint.axis for joint in joints if joint.name == name)
        np.testing.assert_allclose(rotation[:, 2], described[name][0] @ axis / np.linalg.norm(axis), atol=1e-14)
        np.testing.assert_allclose(place, described[name][1], atol=1e-14)
        np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-14)
        assert np.linalg.det(rotation) > 0


@pytest.mark.parametrize("axis", [[0.0, 0.0, 2.0], [0.0, 0.0, -1.0], [1e-9, 0.0, 1.0], [0.0, -3.0, 0.0]])
def test_an_axis_along_or_close_to_a_coordinate_axis_keeps_its_digits(axis):
    rotation = turned(np.random.default_rng(4))
    arm = assemble([a_joint(axis=np.array(axis), rotation=rotation)], tip="forearm")
    np.testing.assert_allclose(arm.rotations[0] @ np.array([0.0, 0.0, 1.0]), rotation @ axis / np.linalg.norm(axis))
    np.testing.assert_allclose(arm.rotations[0].T @ arm.rotations[0], np.eye(3), atol=1e-15)
    if axis[2] == 2.0:
        np.testing.assert_array_equal(arm.rotations[0], rotation)


def merged_by_hand(joints: list[Joint], locked: dict[str, float]) -> dict[str, tuple[float, np.ndarray, np.ndarray]]:
    """Mass, centre and inertia in the base frame of what each joint moves by itself, where all positions are 0."""
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
def test_links_behind_fixed_joints_merge_with_their_carrier(seed):
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
    """By a quarter turn: what was along x is along y."""
    elbow = a_joint(parent="shoulder", center=np.array([0.3, 0.0, 0.0]), translation=np.array([0.4, 0.0, 0.0]))
    arm = assemble(
        [replace(SHOULDER, mass=0.0, inertia=np.zeros((3, 3))), elbow, FLANGE], **TIP, locked={"elbow": np.pi / 2}
    )
    np.testing.assert_allclose(arm.centers, [[0.4, 0.3, 0.0]], atol=1e-15)
    np.testing.assert_allclose(arm.inertias, [np.diag([0.04, 0.03, 0.05])], atol=1e-16)
    np.testing.assert_allclose(arm.tip_rotation, [[0, -1, 0], [1, 0, 0], [0, 0, 1]], atol=1e-15)
    assert arm.joint_names == ("shoulder",)


# The others are alike but for their numbers.
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
