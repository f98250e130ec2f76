import re

import numpy as np
import pytest

pytest.importorskip("collada")

from slidax import arms
from slidax.arms.files import urdf_drawing
from slidax.core.errors import DefinitionError, DefinitionWarning
from slidax.report.replay.drawing import draw
from slidax.report.replay.shapes import _folders, find_urdf, mesh_solids
from slidax.report.replay.skeleton import skeleton_of

from .runs import crane, crane_run

URDF = """<robot name="arm">
  <material name="red"><color rgba="1 0 0 1"/></material>
  <link name="base"><visual><geometry><box size="0.2 0.2 0.1"/></geometry></visual></link>
  <joint name="turn" type="revolute">
    <parent link="base"/><child link="boom"/><origin xyz="0 0 0.3" rpy="0 0.4 0"/><axis xyz="0 1 0"/>
    <limit lower="-2" upper="2" effort="9" velocity="9"/>
  </joint>
  <link name="boom">
    <visual><origin xyz="0.25 0 0"/><geometry><box size="0.5 0.04 0.06"/></geometry><material name="red"/></visual>
  </link>
  <joint name="slide" type="prismatic">
    <parent link="boom"/><child link="hand"/><origin xyz="0.5 0 0"/><axis xyz="1 0 0"/>
    <limit lower="0" upper="1" effort="9" velocity="9"/>
  </joint>
  <link name="hand"/>
  <joint name="bolt" type="fixed"><parent link="hand"/><child link="tool"/><origin xyz="0 0 -0.1"/></joint>
  <link name="tool"><visual><geometry><sphere radius="0.03"/></geometry></visual></link>
</robot>
"""


@pytest.fixture
def urdf(tmp_path):
    path = tmp_path / "arm.urdf"
    path.write_text(URDF)
    return path


def vertices_at(robot, solid, q):
    poses = skeleton_of(robot).poses(np.array([q]))
    return solid.vertices @ poses.rotations[0, solid.body].T + poses.positions[0, solid.body]


def test_meshes_move_with_the_bodies_that_carry_them(urdf):
    robot = crane()
    solids = {solid.body: solid for solid in mesh_solids(skeleton_of(robot), urdf, tools=True)}
    assert sorted(solids) == [0, 1, 2] and solids[1].colour == (255, 0, 0)
    np.testing.assert_allclose(np.ptp(vertices_at(robot, solids[0], [0, 0]), axis=0), [0.2, 0.2, 0.1], atol=1e-9)
    # A quarter turn back from the tilt about y: the boom, along x at 0, stands upright.
    upright = vertices_at(robot, solids[1], [-0.4 - np.pi / 2, 0.0])
    np.testing.assert_allclose(np.ptp(upright, axis=0), [0.06, 0.04, 0.5], atol=1e-9)
    np.testing.assert_allclose(upright.mean(axis=0), [0, 0, 0.55], atol=1e-6)
    ball = vertices_at(robot, solids[2], [-0.4, 0.2])
    np.testing.assert_allclose((ball.min(axis=0) + ball.max(axis=0)) / 2, [0.7, 0, 0.2], atol=1e-6)


def test_links_behind_fixed_joints_can_be_omitted(urdf):
    solids = mesh_solids(skeleton_of(crane()), urdf, tools=False)
    assert sorted(solid.body for solid in solids) == [0, 1]


def test_the_urdf_of_another_robot_is_refused(urdf):
    with pytest.raises(DefinitionError, match=r"arm\.urdf has no joint `panda_joint1`"):
        mesh_solids(skeleton_of(arms.panda()), urdf, tools=True)
    with pytest.raises(DefinitionError, match="joint `turn` moves differently"):
        mesh_solids(skeleton_of(crane(height=0.31)), urdf, tools=True)


def test_a_urdf_without_meshes_and_a_missing_urdf_are_refused(urdf, tmp_path):
    bare = tmp_path / "bare.urdf"
    bare.write_text(re.sub("<visual>.*</visual>", "", urdf.read_text()))
    with pytest.raises(DefinitionError, match="has no meshes"):
        mesh_solids(skeleton_of(crane()), bare, tools=True)
    with pytest.raises(DefinitionError, match="cannot read"):
        mesh_solids(skeleton_of(crane()), tmp_path / "absent.urdf", tools=True)


def with_a_mesh(urdf, name):
    urdf.write_text(urdf.read_text().replace('<box size="0.5 0.04 0.06"/>', f'<mesh filename="{name}" scale="2 1 1"/>'))


def test_a_mesh_has_the_scale_and_colour_of_the_urdf(urdf):
    trimesh = pytest.importorskip("trimesh")
    trimesh.creation.box(extents=[0.25, 0.04, 0.06]).export(urdf.parent / "boom.stl")
    boxes = {solid.body: solid for solid in mesh_solids(skeleton_of(crane()), urdf, tools=True)}
    with_a_mesh(urdf, "boom.stl")
    meshes = {solid.body: solid for solid in mesh_solids(skeleton_of(crane()), urdf, tools=True)}
    assert meshes[1].colour == (255, 0, 0)
    corners = [np.unique(solids[1].vertices.round(6), axis=0) for solids in (boxes, meshes)]
    np.testing.assert_allclose(*corners, atol=1e-5)


@pytest.mark.parametrize("text", [None, "solid no mesh"])
def test_a_missing_mesh_is_named_and_the_others_are_drawn(urdf, text):
    with_a_mesh(urdf, "lost.stl")
    if text is not None:
        (urdf.parent / "lost.stl").write_text(text)
    with pytest.warns(DefinitionWarning, match=r"arm\.urdf: not drawn: `lost\.stl` of link `boom` \(") as caught:
        solids = mesh_solids(skeleton_of(crane()), urdf, tools=True)
    assert len(caught) == 1 and sorted(solid.body for solid in solids) == [0, 2]


def test_an_arm_without_readable_meshes_has_plain_shapes(urdf):
    with_a_mesh(urdf, "lost.stl")
    urdf.write_text(re.sub("<visual><geometry>.*</visual>", "", urdf.read_text()))
    plant, run = crane_run(torque=20.0)
    with pytest.warns(DefinitionWarning, match=r"not drawn: `lost\.stl`"):
        drawn = draw(run, plant, rate=60.0, most=10, urdf=urdf)
    plain = draw(run, plant, rate=60.0, most=10, plain=True)
    for solid, expected in zip(drawn.solids, plain.solids, strict=True):
        np.testing.assert_array_equal(solid.vertices, expected.vertices)


@pytest.mark.parametrize("name", ["panda_description/urdf/panda.urdf", "ur_description/urdf/ur5_robot.urdf"])
def test_drawn_link_poses_agree_with_pinocchio(name):
    pinocchio = pytest.importorskip("pinocchio")
    (folder,) = _folders() or pytest.skip("example-robot-data is not installed")
    urdf, model = urdf_drawing(folder / name), pinocchio.buildModelFromUrdf(str(folder / name))
    data = model.createData()
    moving = [joint for joint in urdf.tree.order if model.existJointName(joint)]
    assert len(moving) >= 6
    for seed in range(3):
        q = np.random.default_rng(seed).uniform(-1.0, 1.0, model.nq)
        pinocchio.framesForwardKinematics(model, data, q)
        places = urdf.frames({joint: float(q[model.joints[model.getJointId(joint)].idx_q]) for joint in moving})
        base = data.oMf[model.getBodyId(urdf.tree.root)].homogeneous
        for link, place in places.items():
            np.testing.assert_allclose(base @ place, data.oMf[model.getBodyId(link)].homogeneous, atol=1e-12)


@pytest.mark.skipif(not _folders(), reason="example-robot-data is not installed")
def test_find_urdf_locates_meshes_of_a_built_in_robot_by_its_joint_names():
    skeleton = skeleton_of(arms.xarm7())
    result = find_urdf(skeleton)
    assert result is not None and result.name == "xarm7.urdf"
    assert sorted({solid.body for solid in mesh_solids(skeleton, result, tools=False)}) == list(range(8))
    # An arm with these joint names exists, but with other lengths.
    assert find_urdf(skeleton_of(arms.ur5e())) is None
