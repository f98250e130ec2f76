import dataclasses
from itertools import product

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

pytest.importorskip("trimesh")

from slidax import arms
from slidax.core.errors import DefinitionError
from slidax.plant import Constant
from slidax.report.replay.drawing import FIELD_OF_VIEW, camera_for, draw
from slidax.report.replay.skeleton import sample_run, skeleton_of
from slidax.report.replay.solids import DESIRED, JOINT, LINK, Solid, merge_solids, turn_up

from .runs import coupled_run, crane_run, scara, two_link


@pytest.fixture(scope="module")
def drawn(swing):
    plant, run = swing
    return draw(run, plant, rate=60.0, most=1000)


def test_replay_frames_are_evenly_spaced_from_the_first_sample_to_the_last(drawn):
    t = drawn.motion.t
    assert len(t) == 31
    np.testing.assert_allclose(np.diff(t), 1 / 60, rtol=1e-9)
    assert t[0] == drawn.run.log.t[0] and t[-1] == drawn.run.log.t[-1]


def test_a_frame_has_the_arms_pose_at_that_time(drawn):
    log, film = drawn.run.log, drawn.motion
    for frame in (0, 12, 30):
        sample = int(np.argmin(np.abs(log.t - film.t[frame])))
        assert log.t[sample] == pytest.approx(film.t[frame], abs=1e-9)
        for q, poses, tips in (
            (log.state.q, film.actual, film.actual_tip),
            (log.reference.q, film.desired, film.desired_tip),
        ):
            angles = np.cumsum(q[sample])
            np.testing.assert_allclose(poses.rotations[frame, 2, :2, 0], [np.cos(angles[1]), np.sin(angles[1])])
            lengths = np.asarray(drawn.skeleton.translations[1, 0]), np.asarray(drawn.skeleton.tip_translation[0])
            tip = [sum(lengths * np.cos(angles)), sum(lengths * np.sin(angles)), 0.0]
            np.testing.assert_allclose(tips[frame], tip, atol=1e-12)


def test_a_time_selects_the_nearest_frame(drawn):
    film = drawn.motion
    assert [film.frame(t) for t in (-1.0, 0.0, 0.1, 0.108, 0.109, 9.0)] == [0, 0, 6, 6, 7, 30]


def test_a_long_run_has_fewer_frames_per_second(swing):
    plant, run = swing
    film = sample_run(run, skeleton_of(plant.robot), 1e6, 40)
    assert len(film.t) == 40


@pytest.mark.parametrize("wild", [np.nan, np.inf, -1e300])
def test_replay_omits_the_samples_after_a_run_has_diverged(wild, swing):
    plant, run = swing
    for where in (lambda run: run.log.state.q, lambda run: run.log.tau):
        values = np.array(where(run))
        values[-2:, 1] = wild
        film = sample_run(eqx.tree_at(where, run, values), skeleton_of(plant.robot), 60.0, 1000)
        assert film.t[-1] == run.log.t[-3] and np.isfinite(film.actual.positions).all()


def test_runs_without_a_log_or_of_another_robot_are_refused(swing):
    plant, run = swing
    with pytest.raises(DefinitionError, match="log_every"):
        draw(dataclasses.replace(run, log=None), plant, rate=60.0, most=1000)
    with pytest.raises(DefinitionError, match="2 joints, but this robot has 7"):
        draw(run, arms.panda(), rate=60.0, most=1000)
    with pytest.raises(DefinitionError, match="must be a plant or a robot; got a `Constant`"):
        draw(run, Constant([0.0, 0.0]), rate=9.0, most=9)


def test_the_arm_stands_upright_above_the_ground(drawn):
    stage = drawn.stage
    np.testing.assert_allclose(stage.rotation @ [0, 1, 0], [0, 0, 1], atol=1e-12)
    np.testing.assert_allclose(stage.rotation @ [1, 0, 0], [1, 0, 0], atol=1e-12)
    for poses in (drawn.motion.actual, drawn.motion.desired):
        assert stage.points(poses.positions.reshape(-1, 3))[:, 2].min() > 0
    lowest = min(stage.points(solid.vertices)[:, 2].min() for solid in drawn.solids if solid.body == 0)
    assert lowest == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("up", [[0, 0, 1], [0, 0, -1], [0, 1, 0], [0.6, 0, 0.8]])
def test_up_direction_becomes_z_by_a_proper_rotation(up):
    turn = turn_up(np.array(up, dtype=float))
    np.testing.assert_allclose(turn @ up, [0, 0, 1], atol=1e-12)
    np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(turn) == pytest.approx(1.0)


def assert_seen(camera, target, points):
    look = (target - camera) / np.linalg.norm(target - camera)
    right = np.cross(look, [0, 0, 1])
    right = right / np.linalg.norm(right)
    offsets = points - camera
    depth = offsets @ look
    assert depth.min() > 0
    assert np.abs(offsets @ np.cross(right, look) / depth).max() < np.tan(FIELD_OF_VIEW / 2)
    assert np.abs(offsets @ right / depth).max() < 1.2 * np.tan(FIELD_OF_VIEW / 2)


@pytest.mark.parametrize("load", [two_link, scara])
def test_the_camera_sees_the_whole_path_and_both_arms_side_by_side(load):
    scenario = load()
    picture = draw(scenario.simulate(progress=False), scenario.plant, rate=60.0, most=1000)
    stage = picture.stage
    points = stage.points(np.concatenate([picture.motion.actual.positions.reshape(-1, 3), picture.motion.actual_tip]))
    assert_seen(stage.camera, stage.target, points)
    assert_seen(stage.wide_camera, stage.wide_target, np.concatenate([points, points + stage.shift]))


@pytest.mark.parametrize("size", [(9, 1, 1), (1, 9, 1), (1, 1, 9)])
def test_the_camera_sees_wide_and_high_scenes(size):
    corners = np.array(list(product(*([0.0, float(side)] for side in size))))
    camera, target, diagonal = camera_for(corners, np.array([0.6, -0.64, 0.48]))
    assert_seen(camera, target, corners)
    assert diagonal == pytest.approx(np.linalg.norm(size))


def test_the_arms_do_not_overlap_side_by_side(drawn):
    points = drawn.stage.points(np.concatenate([drawn.motion.actual.positions.reshape(-1, 3), drawn.motion.actual_tip]))
    aside = drawn.stage.shift / np.linalg.norm(drawn.stage.shift)
    assert np.linalg.norm(drawn.stage.shift) > np.ptp(points @ aside)


def test_plain_shapes_reach_from_joint_to_joint_and_are_thinner_at_the_tip(drawn):
    first, second = (_links(drawn.solids, body) for body in (1, 2))
    lengths = drawn.skeleton.translations[1, 0], drawn.skeleton.tip_translation[0]
    for vertices, length in zip((first, second), lengths, strict=True):
        assert vertices[:, 0].min() < 0 < length < vertices[:, 0].max() < 1.1 * length
    thickness = [np.ptp(vertices[:, 1]) for vertices in (first, second)]
    assert thickness[0] > thickness[1] > 0.02
    assert {solid.colour for solid in drawn.solids if solid.body == 1} == {LINK, JOINT}
    assert all(solid.colour != DESIRED for solid in drawn.solids)


def _links(solids, body):
    (link,) = [solid for solid in solids if (solid.body, solid.colour) == (body, LINK)]
    return link.vertices


def test_the_rod_of_a_prismatic_joint_always_reaches_its_sleeve():
    scenario = scara()
    run = scenario.simulate(progress=False)
    drawn = draw(run, scenario.plant, rate=60.0, most=1000)
    # The slide's z axis points down; at the largest q the rod still begins above the sleeve.
    assert _links(drawn.solids, 3)[:, 2].min() < -float(np.abs(run.log.state.q[:, 2]).max())


def test_an_arm_with_a_follower_is_drawn_with_the_follower_in_its_place():
    plant, run = coupled_run()
    robot, drawing = plant.robot, draw(run, plant, rate=20.0, most=100)
    film, bones = drawing.motion, drawing.skeleton
    assert bones.driven == robot.joint_names and set(bones.names) - set(bones.driven) == {"arm"}
    log = drawing.run.log
    sample = int(np.argmin(np.abs(np.asarray(log.t) - film.t[-1])))
    np.testing.assert_allclose(film.actual_tip[-1], robot.tip(jnp.asarray(log.state.q[sample])), atol=1e-9)
    follower = bones.names.index("arm")
    assert film.travel[follower] >= abs(float(robot.positions(jnp.asarray(log.state.q[sample]))[follower]))


def test_solids_of_one_body_and_colour_are_merged():
    corners = np.eye(3)
    parts = [Solid(1, corners, np.array([[0, 1, 2]]), LINK), Solid(1, corners + 1.0, np.array([[2, 1, 0]]), LINK)]
    (item, other) = merge_solids([*parts, Solid(2, corners, np.array([[0, 1, 2]]), LINK)])
    np.testing.assert_array_equal(item.faces, [[0, 1, 2], [5, 4, 3]])
    assert (item.body, other.body) == (1, 2)


def test_the_reference_arm_is_thinner_so_that_the_true_arm_hides_it(drawn):
    (drum,) = [solid for solid in drawn.solids if (solid.body, solid.colour) == (1, JOINT)]
    radius = np.linalg.norm(drum.vertices[:, :2], axis=1).max()
    thin = np.linalg.norm(drum.shrunk(0.01)[:, :2], axis=1).max()
    assert radius - 0.011 < thin < radius - 0.005


def test_drawn_torque_limits_are_the_lower_of_arm_and_drive_limits():
    plant, run = crane_run(torque=30.0)
    for arm, limits in ((plant.robot, [20.0, 40.0]), (plant, [20.0, 30.0])):
        np.testing.assert_array_equal(draw(run, arm, rate=9.0, most=9, plain=True).torque_limits, limits)


def test_plain_shapes_and_a_urdf_together_are_refused(swing, tmp_path):
    plant, run = swing
    with pytest.raises(DefinitionError, match="`plain` draws plain shapes"):
        draw(run, plant, rate=60.0, most=1000, plain=True, urdf=tmp_path / "arm.urdf")
