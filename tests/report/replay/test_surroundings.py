import dataclasses

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

pytest.importorskip("viser")

from slidax.arms import Payload, TimedPayload
from slidax.report import replay
from slidax.report.replay.drawing import draw, make_stage
from slidax.simulation import MujocoPlant, Plant, Table

from .runs import crane_run
from .test_drawing import assert_seen
from .test_record import recorded

SIDES = np.array([0.2, 0.12, 0.06])
MASS = 1.5
CENTER = np.array([0.01, 0.02, 0.08])
BOX = Payload(MASS, CENTER, MASS / 12 * np.diag((SIDES**2).sum() - SIDES**2))
ATTACHED, RELEASED = 0.099, 0.199


@pytest.fixture(scope="module")
def ours():
    return crane_run(torque=100.0, load=TimedPayload(BOX, ATTACHED, RELEASED))


@pytest.fixture(scope="module")
def mujocos():
    pytest.importorskip("mujoco")
    return crane_run(torque=100.0, load=TimedPayload(BOX, ATTACHED, RELEASED), table=Table(-0.6), mujoco=True)


def drawn(moved):
    plant, run = moved
    return draw(run, plant, rate=50.0, most=1000, plain=True)


def load_of(drawing):
    assert drawing.payload is not None
    return drawing.payload


def assert_with_the_tip(moved, picture, frames):
    plant, run = moved
    for frame in frames:
        sample = int(np.argmin(np.abs(run.log.t - picture.motion.t[frame])))
        rotation, place = plant.robot.tip_frame(jnp.asarray(run.log.state.q[sample]))
        np.testing.assert_allclose(load_of(picture).rotations[frame], rotation, atol=1e-9)
        np.testing.assert_allclose(load_of(picture).positions[frame], place, atol=1e-9)


def test_payload_is_drawn_as_the_box_with_its_mass_and_inertia(ours):
    vertices = load_of(drawn(ours)).solid.vertices
    np.testing.assert_allclose(vertices.max(axis=0), CENTER + SIDES / 2, atol=1e-12)
    np.testing.assert_allclose(vertices.min(axis=0), CENTER - SIDES / 2, atol=1e-12)


def test_built_in_payload_follows_the_tip_while_carried_and_is_hidden_otherwise(ours):
    picture = drawn(ours)
    t = picture.motion.t
    assert list(load_of(picture).visible) == list((t > ATTACHED) & (t < RELEASED))
    assert_with_the_tip(ours, picture, np.flatnonzero(load_of(picture).visible))


def test_released_payload_follows_its_free_motion(mujocos):
    way = mujocos[1].load
    picture = drawn(mujocos)
    load, t = load_of(picture), picture.motion.t
    assert list(load.visible) == list(t > ATTACHED)
    assert_with_the_tip(mujocos, picture, np.flatnonzero((t > ATTACHED) & (t < RELEASED)))
    free = np.flatnonzero(t > RELEASED)
    assert len(free) == 6
    for frame in free:
        sample = int(np.argmin(np.abs(way.t - t[frame])))
        np.testing.assert_allclose(load.rotations[frame], way.rotation[sample], atol=1e-9)
        np.testing.assert_allclose(load.positions[frame], way.position[sample], atol=1e-9)
    assert load.positions[-1, 2] < picture.motion.actual_tip[-1, 2] - 0.02


def test_pose_of_a_falling_box_is_interpolated_between_samples(mujocos):
    plant, run = mujocos
    way = run.load
    coarse = eqx.tree_at(lambda way: (way.t, way.rotation, way.position), way, (way.t[::25], *_every(way, 25)))
    load = load_of(drawn((plant, eqx.tree_at(lambda run: run.load, run, coarse))))
    exact = load_of(drawn(mujocos))
    np.testing.assert_allclose(
        load.rotations @ load.rotations.transpose(0, 2, 1), np.tile(np.eye(3), (16, 1, 1)), atol=1e-9
    )
    np.testing.assert_allclose(load.rotations, exact.rotations, atol=0.05)
    np.testing.assert_allclose(load.positions, exact.positions, atol=0.01)


def _every(way, step):
    return way.rotation[::step], way.position[::step]


def test_a_payload_stays_at_its_last_known_pose(mujocos):
    plant, run = mujocos
    for known in (0, 1, 20):
        place = np.array(run.load.position)
        place[known:] = np.nan
        load = load_of(drawn((plant, eqx.tree_at(lambda run: run.load.position, run, place))))
        assert np.isfinite(load.positions).all() and load.visible[-1] == (known > 0)
        if known:
            np.testing.assert_array_equal(load.positions[-1], run.load.position[known - 1])


def test_a_robot_without_payload_has_no_box(ours):
    plant, run = ours
    empty = eqx.tree_at(lambda plant: plant.load.payload.mass, plant, jnp.array(0.0))
    for arm in (plant.robot, empty, Plant(plant.robot, plant.disturbance)):
        picture = draw(run, arm, rate=50.0, most=1000, plain=True)
        assert picture.payload is None and picture.table is None


def with_table(ours, height, gravity):
    plant, run = ours
    robot = eqx.tree_at(lambda robot: robot.gravity_vector, plant.robot, jnp.array(gravity))
    table = MujocoPlant(robot, plant.disturbance, load=plant.load, surroundings=Table(height))
    return draw(run, table, rate=50.0, most=1000, plain=True)


@pytest.mark.parametrize(
    ("height", "gravity"), [(-0.5, (0.0, 0.0, -9.81)), (0.0, (0.0, 9.81, 0.0)), (0.31, (6.0, 0.0, -8.0))]
)
def test_the_table_is_perpendicular_to_gravity_at_its_height(height, gravity, ours):
    picture = with_table(ours, height, gravity)
    stage = picture.stage
    based = (picture.table.vertices - stage.base) @ stage.rotation
    above = based @ -np.array(gravity) / np.linalg.norm(gravity)
    assert above.max() == pytest.approx(height, abs=1e-12)
    # From above, the upper face covers the whole slab and the whole path of the tip.
    corners = picture.table.vertices[above > height - 1e-9, :2]
    np.testing.assert_array_equal(np.ptp(corners, axis=0), np.ptp(picture.table.vertices[:, :2], axis=0))
    assert above.min() > height - 0.05
    tips = stage.points(picture.motion.actual_tip)[:, :2]
    assert (corners.min(axis=0) < tips.min(axis=0)).all() and (tips.max(axis=0) < corners.max(axis=0)).all()


def test_the_ground_is_below_the_table_and_coincides_with_no_face(ours):
    picture = drawn(ours)
    # The boom is level, so that the base is on the ground.
    level = picture.skeleton.poses(np.tile([-0.4, 0.0], (16, 1)))
    tips = picture.skeleton.tips(level)
    motion = dataclasses.replace(picture.motion, actual=level, desired=level, actual_tip=tips, desired_tip=tips)
    for height in (-0.5, -0.01, 0.0, 0.01, 0.012, 0.02, 0.31):
        room = make_stage(picture.skeleton, motion, None, height)
        assert room.ground <= 0 and room.table[0, 2] > room.ground + 1e-3
        assert room.table[1, 2] == pytest.approx(room.height + height)


def test_the_camera_sees_the_table_and_the_payload_on_it(mujocos):
    picture = drawn(mujocos)
    box = picture.stage.points(load_of(picture).corners(load_of(picture).visible))
    assert_seen(picture.stage.camera, picture.stage.target, np.concatenate([box, picture.table.vertices]))


def test_a_payload_that_falls_far_does_not_enlarge_the_scene(mujocos):
    plant, run = mujocos
    place = run.load.position - np.linspace(0, 1000, len(run.load.t))[:, None] * [0, 0, 1]
    bare = eqx.tree_at(lambda plant: plant.surroundings, plant, None)
    falling = drawn((bare, eqx.tree_at(lambda run: run.load.position, run, place)))
    assert falling.stage.size < 1.2 * drawn(mujocos).stage.size


def test_a_replay_shows_the_payload_at_its_pose_and_hides_it(mujocos, ours):
    for plant, run in (mujocos, ours):
        with replay.show(run, plant, open_browser=False, plain=True) as view:
            # The clock of the view would show its first picture at any time.
            view._player.stop()
            load, node = load_of(view._drawing), view._scene.payload
            assert node is not None
            for t in (0.25, 0.0, 0.15):
                view._show(t)
                frame = view._drawing.motion.frame(t)
                np.testing.assert_allclose(node.node.position, load.positions[frame], atol=1e-6)
                assert node.node.visible == bool(load.visible[frame])
            table = view._server.scene.get_handle_by_name("/table")
            assert (table is None) == (view._drawing.table is None)


def test_a_page_shows_the_payload_from_pick_up_to_release(ours, tmp_path):
    plant, run = ours
    page = replay.record(run, plant, tmp_path / "crane.html", plain=True).read_text(encoding="utf-8")
    text = [
        (t, message["visible"])
        for t, message in recorded(page)["messages"]
        if message["type"] == "SetSceneNodeVisibilityMessage" and message["name"] == "/arm/load"
    ]
    turns = [at for at, before in zip(text[1:], text[:-1], strict=True) if at[1] != before[1]]
    assert not text[0][1]
    assert turns == [(pytest.approx(ATTACHED, abs=0.02), True), (pytest.approx(RELEASED, abs=0.02), False)]
