"""Tool paths: poses over time, smooth joint motions, and refused moves."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.interpolate import PPoly
from scipy.spatial.transform import Rotation, Slerp

from slidax import arms
from slidax.arms import Pose
from slidax.arms.chain import kinematic_chain
from slidax.core.errors import DefinitionError
from slidax.motions import Circle, Line, Pause, Screw, Through, follow
from tests.arms.kinematics.postures import home

TIGHT = 3e-6


def tool(arm, followed, times):
    """Orientation and place of the tool at some times."""
    trajectory = followed.trajectory
    motion = PPoly(np.asarray(trajectory.coefficients), np.asarray(trajectory.times))
    return kinematic_chain(arm).frame(motion(np.clip(times, motion.x[0], motion.x[-1])))


def smooth(z):
    return 10 * z**3 - 15 * z**4 + 6 * z**5


def assert_continuous(trajectory):
    """Positions, velocities and accelerations at both sides of each knot, and rest at the ends."""
    times, c = np.asarray(trajectory.times), np.asarray(trajectory.coefficients)
    h = np.diff(times)[:, None]
    for order, room in ((0, 1e-12), (1, 1e-10), (2, 1e-7)):
        powers = np.arange(5, -1, -1)
        weights = np.prod([powers - k for k in range(order)], axis=0) if order else np.ones(6)
        right = sum(w * a * h ** max(p - order, 0) for w, a, p in zip(weights, c, powers, strict=True) if p >= order)
        left = c[5 - order] * (1, 1, 2)[order]
        np.testing.assert_allclose(right[:-1], left[1:], atol=room)
        if order:
            np.testing.assert_allclose([left[0], right[-1]], 0, atol=room)


@pytest.mark.parametrize("name", ["ur5e", "panda"])
def test_line_move_is_straight_and_interpolates_orientation_by_slerp(name):
    arm, start = getattr(arms, name)(), home(name)
    pose = Pose.of_tip(arm, start)
    end = (Rotation.from_matrix(pose.rotation) * Rotation.from_rotvec([0.2, -0.3, 0.1])).as_matrix()
    line = Line(by=[0.08, 0.1, -0.05], quaternion=Pose(pose.position, end).quaternion, duration=2.0)
    followed = follow(arm, [line], start=start, begin=0.5)
    times = np.linspace(0.5, 2.5, 101)
    rotation, place = tool(arm, followed, times)
    s = smooth((times - 0.5) / 2.0)
    np.testing.assert_allclose(place, pose.position + s[:, None] * np.array([0.08, 0.1, -0.05]), atol=TIGHT)
    between = Slerp([0, 1], Rotation.from_matrix([pose.rotation, end]))(s).as_matrix()
    np.testing.assert_allclose(rotation, between, atol=TIGHT)
    assert followed.position_error < 1e-6 and followed.rotation_error < 1e-6
    assert_continuous(followed.trajectory)
    np.testing.assert_allclose(followed.trajectory.position(jnp.asarray(0.0)), start, atol=1e-12)
    assert float(followed.trajectory.until) == 2.5


def test_full_circle_of_a_redundant_arm_ends_at_its_initial_joint_positions():
    arm, start = arms.panda(), home("panda")
    pose = Pose.of_tip(arm, start)
    circle = Circle(
        center=pose.position + np.array([0.0, 0.1, 0.0]), axis=[0, 0, 1], angle=-2 * np.pi, speed=0.25, acceleration=1.5
    )
    followed = follow(arm, [circle], start=start)
    times = np.linspace(0, float(followed.trajectory.until), 201)
    rotation, place = tool(arm, followed, times)
    np.testing.assert_allclose(np.linalg.norm(place - pose.position - [0, 0.1, 0], axis=1), 0.1, atol=TIGHT)
    np.testing.assert_allclose(rotation, np.broadcast_to(pose.rotation, rotation.shape), atol=TIGHT)
    np.testing.assert_allclose(followed.trajectory.position(jnp.asarray(times[-1])), start, atol=1e-8)
    # In between the tip moves at the requested speed.
    speeds = np.linalg.norm(np.diff(place, axis=0), axis=1) / np.diff(times)
    assert abs(speeds.max() - 0.25) < 1e-3 and abs(speeds[100] - 0.25) < 1e-3
    assert_continuous(followed.trajectory)


def test_screw_move_turns_and_shifts_the_tool_and_a_pause_holds_it():
    arm, start = arms.ur5e(), home("ur5e")
    pose = Pose.of_tip(arm, start)
    moves = [Screw(axis=[0, 0, -2], angle=np.pi / 2, pitch=0.2, duration=1.5), Pause(duration=0.5)]
    followed = follow(arm, moves, start=start)
    rotation, place = tool(arm, followed, [1.5, 1.75, 2.0])
    np.testing.assert_allclose(place, np.broadcast_to(pose.position - [0, 0, 0.05], (3, 3)), atol=TIGHT)
    turned = Rotation.from_rotvec([0, 0, -np.pi / 2]).as_matrix() @ pose.rotation
    np.testing.assert_allclose(rotation, np.broadcast_to(turned, (3, 3, 3)), atol=TIGHT)
    np.testing.assert_array_equal(followed.ends, [1.5, 2.0])


def test_curve_passes_through_its_poses_at_the_requested_times():
    arm, start = arms.panda(), home("panda")
    pose = Pose.of_tip(arm, start)
    first, second = pose.position + np.array([0.05, 0.05, 0.0]), pose.position + np.array([0.0, 0.1, -0.05])
    followed = follow(arm, [Through(poses=[first, second])], start=start, velocity=1.0, acceleration=4.0)
    times = np.linspace(0, float(followed.trajectory.until), 2001)
    _, place = tool(arm, followed, times)
    assert min(np.linalg.norm(place - first, axis=1)) < 1e-3
    np.testing.assert_allclose(place[-1], second, atol=TIGHT)
    # In the shortest time a limit is reached and none is exceeded.
    v, a = followed.trajectory.extremes(1).size / 1.0, followed.trajectory.extremes(2).size / 4.0
    assert max(v.max(), a.max()) == pytest.approx(1.0, abs=1e-9)

    quaternion = (Rotation.from_matrix(pose.rotation) * Rotation.from_rotvec([0, 0, 0.4])).as_quat(scalar_first=True)
    rows = [[0.0, *pose.position, *pose.quaternion], [0.7, *first, *-quaternion], [1.5, *second, *quaternion]]
    text = "time, x, y, z, qw, qx, qy, qz\n" + "\n".join(", ".join(f"{x:.17g}" for x in row) for row in rows)
    followed = follow(arm, [Through.from_csv(text)], start=start, begin=1.0)
    rotation, place = tool(arm, followed, [1.7, 2.5])
    np.testing.assert_allclose(place, [first, second], atol=TIGHT)
    wanted = Rotation.from_quat(quaternion, scalar_first=True).as_matrix()
    np.testing.assert_allclose(rotation, [wanted, wanted], atol=TIGHT)
    assert_continuous(followed.trajectory)


def test_planar_arm_follows_a_position_path_and_refuses_a_move_off_its_plane():
    from tests.arms.kinematics.test_inverse import PLANAR

    followed = follow(PLANAR, [Line(by=[-0.3, 0.2, 0.0], duration=1.0)], start=[0.3, 1.2], hold="place")
    end = kinematic_chain(PLANAR).frame(np.asarray(followed.trajectory.position(jnp.asarray(1.0))))[1]
    np.testing.assert_allclose(
        end, kinematic_chain(PLANAR).frame(np.array([0.3, 1.2]))[1] + [-0.3, 0.2, 0.0], atol=1e-9
    )
    with pytest.raises(DefinitionError, match="cannot follow beyond"):
        follow(PLANAR, [Line(by=[0, 0, 0.1], duration=1.0)], start=[0.3, 1.2], hold="place")


def test_damping_reports_the_pose_error_at_a_singularity():
    """Move straight out until the arm is stretched, and a millimetre beyond its reach."""
    from tests.arms.kinematics.test_inverse import PLANAR

    start = np.array([0.0, 0.6])
    reach = 1.8 - np.linalg.norm(kinematic_chain(PLANAR).frame(start)[1])
    tip = kinematic_chain(PLANAR).frame(start)[1]
    beyond = Line(by=tip / np.linalg.norm(tip) * (reach + 1e-3), duration=2.0)
    with pytest.raises(DefinitionError, match=r"a singularity, where the tip cannot move along .* `damping`"):
        follow(PLANAR, [beyond], start=start, hold="place")
    followed = follow(PLANAR, [beyond], start=start, hold="place", damping=0.05, tolerance=1e-5)
    assert 1e-4 < followed.position_error < 2e-2
    assert "singularity" in str(followed)
    assert np.isfinite(np.asarray(followed.trajectory.coefficients)).all()


@pytest.mark.parametrize(
    ("message", "moves", "more"),
    [
        (
            r"moves.0: the tool cannot follow beyond t = .* s, .* m along this move.*singularity.*out of reach, too",
            [Line(by=[1.0, 0, 0], duration=3.0)],
            {},
        ),
        (
            r"moves.1: panda_joint. would need .* over its limit of 0.2 for velocity: make the move .* times as long",
            [Line(by=[0.01, 0, 0], duration=3.0), Line(by=[0, 0.2, 0], duration=0.5)],
            {"velocity": 0.2},
        ),
        ("moves.0: the move needs a `duration`", [Line(by=[0.1, 0, 0])], {}),
        ("moves.0: `Line` must change the position", [Line(by=[0, 0, 0], duration=1.0)], {}),
        ("either `to` or `by`", [Line(by=[0, 0, 0.1], to=[0, 0, 0.1], duration=1.0)], {}),
        ("moves.0: `Line.acceleration` is missing", [Line(by=[0, 0, 0.1], speed=1.0)], {}),
        ("its radius is 0", [Circle(center=[0.30701957005161, 0, 0], axis=[0, 0, 1], duration=1.0)], {}),
        ("`Pause.duration` must be given", [Pause()], {}),
        ("must be the tool.s pose at the start", [Through(poses=[[0, 0, 1], [0, 0, 0.5]], times=[0, 1])], {}),
        ("by 1[0-9]+ degrees", [Through(poses=[[0.4, 0, 0.5, 0.8, -0.2, 0.5, 0.1]], duration=1.0)], {}),
        ("`tolerance` must be in", [Pause(duration=1.0)], {"tolerance": 0.0}),
        ("strictly inside the joint limits", [Pause(duration=1.0)], {"posture": [9, 0, 0, -1, 0, 1, 0]}),
    ],
)
def test_impossible_moves_are_errors_with_the_reason(message, moves, more):
    with pytest.raises(DefinitionError, match=message):
        follow(arms.panda(), moves, start=home("panda"), **more)


def test_a_timed_pose_that_is_turned_too_far_is_named_by_its_row():
    start = home("panda")
    first = Pose.of_tip(arms.panda(), start)
    own = [*first.position, *first.quaternion]
    flipped = Pose(first.position, first.rotation @ np.diag([-1.0, 1.0, -1.0]))
    rows = [own, [*own[:2], own[2] - 0.01, *own[3:]], [*flipped.position, *flipped.quaternion]]
    with pytest.raises(DefinitionError, match=r"row 3 of `Through.poses` is rotated by 180"):
        follow(arms.panda(), [Through(poses=rows, times=[0.0, 1.0, 2.0])], start=start)


def test_line_move_with_a_half_turn_is_refused_as_ambiguous():
    arm, start = arms.panda(), home("panda")
    end = Pose.of_tip(arm, start).rotation @ np.diag([-1.0, -1.0, 1.0])
    with pytest.raises(DefinitionError, match="half a turn"):
        follow(arm, [Line(quaternion=Pose([0, 0, 0], end).quaternion, duration=1.0)], start=start)


def test_a_joint_that_would_exceed_its_limit_is_named_with_time_and_position():
    arm, start = arms.ur5e(), home("ur5e")
    near = np.array([*start[:5], 6.2])
    with pytest.raises(DefinitionError, match=r"wrist_3_joint is at its limit of 6.283 at t = .* s, .* would go to"):
        follow(arm, [Screw(axis=Pose.of_tip(arm, near).rotation[:, 2], angle=1.0, duration=1.0)], start=near)


def test_csv_of_poses_may_have_columns_in_any_order_and_in_other_units():
    read = Through.from_csv('\ufeffZ [mm],"time [ms]", X ,y [cm]\n300,0,1,20\n400,500,1.5,30\n')
    np.testing.assert_allclose(read.poses, [[1.0, 0.2, 0.3], [1.5, 0.3, 0.4]], rtol=1e-15)
    np.testing.assert_allclose(read.times, [0.0, 0.5], rtol=1e-15)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("x,y\n1,2\n", "`z` is missing"),
        ("x,y,z,w\n1,2,3,4\n", "`w` is unknown"),
        ("x,y,z\n", "has no row below its column titles"),
        ("x,y,Z,z\n1,2,3,4\n", "`z` occurs twice"),
        ("x [in],y,z\n1,2,3\n", r"column `x \[in\]`: the unit must be one of m, cm, mm"),
    ],
)
def test_csv_of_poses_with_invalid_columns_is_refused_with_the_reason(text, message):
    with pytest.raises(DefinitionError, match=message):
        Through.from_csv(text)
