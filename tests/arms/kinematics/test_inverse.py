"""Inverse kinematics: the posture has the requested pose, is within the limits and is deterministic."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from slidax import arms
from slidax.arms import Pose, Scara, TwoLink, inverse
from slidax.arms.chain import kinematic_chain
from slidax.arms.inverse import jacobian, pose_task
from slidax.core.errors import DefinitionError
from tests.arms.kinematics.postures import drawn, home

READY = arms.built_in_names()
PLANAR = TwoLink(lengths=[1.0, 0.8], masses=[0.5, 1.5], inertias=[5.0, 5.0])
SCARA = Scara(lengths=[0.4, 0.3], masses=[1.0, 1.0, 0.5])


@pytest.mark.parametrize("name", READY)
def test_kinematic_chain_and_arm_model_agree_on_the_tip_pose(name):
    arm = getattr(arms, name)()
    for q in drawn(arm, 1, 3):
        rotation, place = kinematic_chain(arm).frame(q)
        there, tip = arm.tip_frame(jnp.asarray(q))
        np.testing.assert_allclose(rotation, there, atol=1e-14)
        np.testing.assert_allclose(place, tip, atol=1e-14)


@pytest.mark.parametrize("arm", [PLANAR, SCARA], ids=["two_link", "scara"])
def test_tips_of_the_paper_arms_agree_with_their_chains_and_inverse_kinematics(arm):
    q = np.random.default_rng(2).uniform(0.2, 1.2, arm.joints)
    rotation, place = kinematic_chain(arm).frame(q)
    there, tip = arm.tip_frame(jnp.asarray(q))
    np.testing.assert_allclose(place, arm.tip(jnp.asarray(q)), atol=1e-15)
    np.testing.assert_allclose(tip, place, atol=1e-15)
    np.testing.assert_allclose(there, rotation, atol=1e-15)
    solution = inverse(arm, Pose.of_tip(arm, q), start=q + 0.2, hold="place")
    np.testing.assert_allclose(solution.q, q, atol=1e-10)


def test_jacobian_is_the_derivative_of_the_tip():
    arm = arms.panda()
    q = home("panda")
    solution = jacobian(pose_task(kinematic_chain(arm), q, "pose"), q)
    np.testing.assert_allclose(solution[:3], jax.jacfwd(arm.tip)(jnp.asarray(q)), atol=1e-14)
    rotation = np.asarray(arm.tip_frame(jnp.asarray(q))[0])
    by_q = np.asarray(jax.jacfwd(lambda q: arm.tip_frame(q)[0])(jnp.asarray(q)))
    for joint in range(7):
        turning = by_q[:, :, joint] @ rotation.T
        np.testing.assert_allclose(solution[3:, joint], [turning[2, 1], turning[0, 2], turning[1, 0]], atol=1e-14)


@pytest.mark.parametrize("name", READY)
def test_inverse_reaches_the_pose_of_a_random_posture_within_limits(name):
    arm = getattr(arms, name)()
    for q in drawn(arm, 3, 5):
        solution = inverse(arm, Pose.of_tip(arm, q), start=home(name))
        there, wanted = Pose.of_tip(arm, solution.q), Pose.of_tip(arm, q)
        np.testing.assert_allclose(there.position, wanted.position, atol=1e-9)
        np.testing.assert_allclose(there.rotation, wanted.rotation, atol=1e-9)
        assert (solution.q >= arm.limits.lower).all() and (solution.q <= arm.limits.upper).all()
        assert solution.position_error < 1e-9 and solution.rotation_error < 1e-9 and solution.least_motion > 0


def test_inverse_kinematics_is_deterministic_to_the_last_bit():
    arm = arms.panda()
    pose = Pose.of_tip(arm, drawn(arm, 4, 1)[0])
    first, second = (inverse(arm, pose, start=home("panda")).q for _ in range(2))
    assert first.tobytes() == second.tobytes()


def test_posture_cost_of_a_redundant_arm_is_stationary_along_its_null_space():
    """Each solution is also nearer to its own posture than the other solution is."""
    arm = arms.panda()
    start = home("panda")
    pose = Pose.of_tip(arm, start + 0.05)
    postures = start, start + np.array([0.3, 0.0, -0.3, 0.0, 0.2, 0.0, 0.0])
    solutions = [inverse(arm, pose, start=start, posture=posture).q for posture in postures]
    for posture, solution, other in zip(postures, solutions, solutions[::-1], strict=True):
        task = pose_task(kinematic_chain(arm), posture, "pose")
        free = np.linalg.svd(jacobian(task, solution))[2][-1]
        assert abs(free @ task._slope([solution])[0]) < 1e-8
        own, others = (np.sum(((q - posture) / task.widths) ** 2) for q in (solution, other))
        assert own < 0.9 * others


def test_targets_of_position_or_axis_leave_other_coordinates_free():
    arm = arms.panda()
    start = home("panda")
    pose = Pose.of_tip(arm, start)
    moved = Pose(
        pose.position + np.array([0.1, 0.1, 0.0]), np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
    )
    place = inverse(arm, moved, start=start, hold="place")
    axis = inverse(arm, moved, start=start, hold="axis")
    for solution in (place, axis):
        np.testing.assert_allclose(Pose.of_tip(arm, solution.q).position, moved.position, atol=1e-9)
        assert np.abs(Pose.of_tip(arm, solution.q).rotation - moved.rotation).max() > 0.1
    np.testing.assert_allclose(Pose.of_tip(arm, axis.q).rotation[:, 2], [0, 0, -1], atol=1e-9)
    assert np.abs(Pose.of_tip(arm, place.q).rotation[:, 2] - [0, 0, -1]).max() > 1e-3
    assert np.linalg.norm(place.q - start) <= np.linalg.norm(axis.q - start)


def test_unreachable_pose_is_an_error_with_the_distance():
    arm = arms.panda()
    pose = Pose.of_tip(arm, home("panda"))
    with pytest.raises(
        DefinitionError, match=r"no posture found with the tool at \[2, 0, 0.5\] m: the nearest is .* m off"
    ):
        inverse(arm, Pose([2.0, 0.0, 0.5], pose.rotation), start=home("panda"), hold="place")
    with pytest.raises(DefinitionError, match="the nearest is"):
        inverse(arm, Pose([0.0, 0.0, -0.5], pose.rotation), start=home("panda"))


@pytest.mark.parametrize(
    ("message", "how"),
    [
        ("panda_joint4 is at 1, its limits are", {"start": [0, 0, 0, 1, 0, 1, 0]}),
        ("`start` must be 7 finite numbers", {"start": [0, 0]}),
        ('hold: must be "place"', {"start": home("panda"), "hold": "everything"}),
    ],
)
def test_invalid_start_or_hold_is_refused_with_the_reason(message, how):
    arm = arms.panda()
    with pytest.raises(DefinitionError, match=message):
        inverse(arm, Pose.of_tip(arm, home("panda")), **how)


def test_a_pose_without_an_orientation_is_refused():
    with pytest.raises(DefinitionError, match="orthonormal"):
        Pose([0, 0, 0], np.ones((3, 3)))
    with pytest.raises(DefinitionError, match="length > 0"):
        Pose.of([0, 0, 0], [0, 0, 0, 0])
