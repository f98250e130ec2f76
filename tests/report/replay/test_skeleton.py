import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

from slidax import arms
from slidax.arms import Scara, TwoLink
from slidax.core.errors import DefinitionError
from slidax.report.replay import Skeleton, skeleton, skeleton_of
from tests.arms.trees import small_tree

TWO_LINK = TwoLink(lengths=[1.2, 0.8], masses=[1.0, 1.0], inertias=[0.1, 0.1])
SCARA = Scara(lengths=[0.3, 0.2], masses=[1.0, 1.0, 1.0])


COUPLED = arms.couple(small_tree(), {"arm": ("waist", -2.0, 0.2)})


@pytest.mark.parametrize(
    "robot", [arms.panda(), arms.ur5e(), TWO_LINK, SCARA, COUPLED], ids=lambda robot: type(robot).__name__
)
def test_the_tip_of_the_skeleton_is_the_robots_tip(robot):
    bones = skeleton_of(robot)
    postures = np.random.default_rng(0).uniform(-2, 2, (5, robot.joints))
    tips = bones.tips(bones.poses(postures))
    for q, tip in zip(postures, tips, strict=True):
        np.testing.assert_allclose(tip, robot.tip(jnp.asarray(q)), atol=1e-12)


def test_the_bodies_of_a_skeleton_are_the_arms_frames():
    robot = arms.panda()
    postures = np.random.default_rng(1).uniform(-2, 2, (3, 7))
    poses = skeleton_of(robot).poses(postures)
    np.testing.assert_array_equal(poses.rotations[:, 0], np.tile(np.eye(3), (3, 1, 1)))
    for k, q in enumerate(postures):
        rotations, places = robot.frames(jnp.asarray(q))
        np.testing.assert_allclose(poses.rotations[k, 1:], rotations, atol=1e-12)
        np.testing.assert_allclose(poses.positions[k, 1:], places, atol=1e-12)


def test_skeletons_of_the_papers_arms_have_the_expected_points():
    np.testing.assert_allclose(
        skeleton(TWO_LINK, [np.pi / 2, -np.pi / 2]), [[0, 0, 0], [0, 1.2, 0], [0.8, 1.2, 0]], atol=1e-12
    )
    np.testing.assert_allclose(
        skeleton(SCARA, [0.0, np.pi / 2, 0.7]), [[0, 0, 0], [0.3, 0, 0], [0.3, 0.2, -0.7]], atol=1e-12
    )


def test_coincident_joints_are_drawn_as_one_point():
    points = skeleton(arms.panda(), np.zeros(7))
    assert np.linalg.norm(np.diff(points, axis=0), axis=1).min() > 1e-3
    np.testing.assert_allclose(points[1], [0, 0, 0.333], atol=1e-12)


def test_up_direction_is_against_gravity():
    np.testing.assert_array_equal(skeleton_of(TWO_LINK).up, [0, 1, 0])
    np.testing.assert_allclose(skeleton_of(arms.panda()).up, [0, 0, 1])
    hanging = eqx.tree_at(lambda arm: arm.gravity_vector, arms.panda(), jnp.array([0.0, 9.81, 0.0]))
    np.testing.assert_allclose(skeleton_of(hanging).up, [0, -1, 0])
    weightless = eqx.tree_at(lambda arm: arm.gravity_vector, arms.panda(), jnp.zeros(3))
    np.testing.assert_array_equal(skeleton_of(weightless).up, [0, 0, 1])


class Stranger(eqx.Module):
    """A robot class outside slidax."""


def test_a_registered_robot_class_can_be_drawn():
    with pytest.raises(DefinitionError, match=r"`Stranger` has no skeleton.*skeleton_of\.register"):
        skeleton_of(Stranger())

    @skeleton_of.register
    def _(robot: Stranger) -> Skeleton:
        return skeleton_of(TWO_LINK)

    assert skeleton_of(Stranger()).joints == 2


def test_the_reach_is_the_length_along_the_arm():
    robot = arms.panda()
    points = skeleton(robot, np.zeros(7))
    along = np.linalg.norm(np.diff(points, axis=0), axis=1).sum()
    assert skeleton_of(robot).reach == pytest.approx(along)
