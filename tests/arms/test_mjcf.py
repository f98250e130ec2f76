"""Arms from MJCF files."""

from __future__ import annotations

from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest

from slidax.arms import from_mjcf
from slidax.core.errors import DefinitionError
from tests.arms.bad_file import changed
from tests.arms.bad_mjcf import COMPILER, ELBOW, END, FORE, GOOD, INERTIAL, MOTOR, OPTION, SITE, WORLD
from tests.peers.by_mujoco import by_mujoco
from tests.peers.motion import assert_same, by_slidax, random_states

mujoco = pytest.importorskip("mujoco")


def random_mjcf(seed: int, joints: int) -> str:
    """A tree whose tip is the site `tip` and whose joint `locked` must be held."""
    return _Writer(np.random.default_rng(seed), joints).text()


class _Writer:
    def __init__(self, rng: np.random.Generator, joints: int) -> None:
        self.rng, self.wanted = rng, joints
        self.joints: list[str] = []

    def text(self) -> str:
        bodies = self.body(depth=0, tip=True)
        gears = "".join(
            f'<motor joint="{name}" gear="{self.numbers(1, 3.0)}" armature="0.01" damping="0.1"/>'
            for name in self.joints[::2]
        )
        return f"""<mujoco model="tree">
  <compiler angle="{self.rng.choice(["degree", "radian"])}" eulerseq="{self.rng.choice(["xyz", "ZYX", "zxz"])}"/>
  <option gravity="{self.numbers(3, 8.0)}"/>
  <default>
    <joint damping="0.3"/>
    <default class="geared"><joint armature="0.2" frictionloss="0.1"/></default>
  </default>
  <worldbody>{bodies}</worldbody>
  <actuator>{gears}</actuator>
</mujoco>"""

    def body(self, depth: int, tip: bool) -> str:
        rng = self.rng
        joints = "".join(self.joint() for _ in range(rng.integers(1, 3))) if depth != 1 or rng.random() < 0.7 else ""
        if depth == 0:
            joints += self.joint("locked")
        inside = joints + self.weight()
        more = depth < 3 and len(self.joints) < self.wanted
        if more:
            turned = f'<frame pos="{self.numbers(3, 0.2)}" euler="{self.numbers(3, 1.0)}">{{}}</frame>'
            inside += turned.format(self.body(depth + 1, tip))
        elif tip:
            inside += f'<site name="tip" pos="{self.numbers(3, 0.2)}" euler="{self.numbers(3, 1.0)}"/>'
        if more and rng.random() < 0.5:
            inside += self.body(depth + 2, False)
        return f'<body pos="{self.numbers(3, 0.4)}" quat="{self.numbers(4, 1.0)}">{inside}</body>'

    def joint(self, name: str | None = None) -> str:
        name = name or f"j{len(self.joints)}"
        if name != "locked":
            self.joints.append(name)
        kind = self.rng.choice(["hinge", "hinge", "slide"])
        kind = f'type="{kind}" class="{self.rng.choice(["main", "geared"])}"'
        place = f'axis="{self.numbers(3, 1.0)}" pos="{self.numbers(3, 0.1)}" ref="{self.numbers(1, 0.5)}"'
        return f'<joint name="{name}" {kind} {place}/>'

    def weight(self) -> str:
        way = self.rng.integers(3)
        if way == 0:
            size = self.rng.uniform(0.05, 0.2, 3)
            return (
                f'<geom type="box" size="{_words(size)}" pos="{self.numbers(3, 0.1)}" euler="{self.numbers(3, 1.0)}"/>'
            )
        mass = self.rng.uniform(0.5, 3.0)
        root = self.rng.normal(size=(3, 3)) * 0.1
        spread = root @ root.T + 1e-3 * np.eye(3)
        # The inertia of scattered masses is always that of a rigid body.
        inertia = np.trace(spread) * np.eye(3) - spread
        place = f'<inertial pos="{self.numbers(3, 0.1)}" mass="{mass}" '
        if way == 1:
            entries = [inertia[i, j] for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))]
            return place + f'fullinertia="{_words(entries)}"/>'
        return place + f'diaginertia="{_words(np.linalg.eigvalsh(inertia))}" euler="{self.numbers(3, 1.0)}"/>'

    def numbers(self, count: int, size: float) -> str:
        return _words(self.rng.normal(size=count) * size)


def _words(numbers: object) -> str:
    return " ".join(repr(float(number)) for number in np.atleast_1d(np.asarray(numbers)))


EXAMPLES = Path(__file__).parents[2] / "examples" / "robots"
HELD = {"locked": 0.3}
TREES = [
    pytest.param(0, 4, 100, id="tree 0"),
    *(pytest.param(seed, 8, 1000, id=f"tree {seed}-full", marks=pytest.mark.full) for seed in range(1, 22)),
]
TETRAHEDRON = "v 0 0 0\nv .1 0 0\nv 0 .1 0\nv 0 0 .1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"


@pytest.mark.parametrize(("seed", "joints", "count"), TREES)
def test_random_tree_agrees_with_mujoco(seed, joints, count):
    text = random_mjcf(seed, joints)
    arm = from_mjcf(text, tip="tip", locked=HELD)
    assert arm.joints >= 4 and "locked" not in arm.joint_names
    states = random_states(arm, count)
    theirs = by_mujoco(mujoco.MjModel.from_xml_string(text), "tip", arm.joint_names, states, HELD)
    assert_same(by_slidax(arm, states), theirs)


@pytest.mark.parametrize("seed", [0, 1])
def test_friction_of_a_random_tree_agrees_with_mujoco(seed):
    text = random_mjcf(seed, 4)
    arm = from_mjcf(text, tip="tip", locked=HELD)
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    at = [int(model.joint(name).dofadr[0]) for name in arm.joint_names]
    data.qvel[at] = np.linspace(-1.0, 1.0, arm.joints)
    mujoco.mj_forward(model, data)
    np.testing.assert_allclose(data.qfrc_passive[at], -arm.viscous * data.qvel[at], rtol=1e-13)
    np.testing.assert_array_equal(arm.coulomb, model.dof_frictionloss[at])


def test_arm_has_the_parameters_of_the_mjcf():
    arm = from_mjcf(GOOD)
    assert arm.name == "arm" and arm.link_names == ("upper", "fore")
    np.testing.assert_allclose(arm.limits.lower, np.deg2rad([-100.0, -60.0]), rtol=1e-14)
    np.testing.assert_allclose(arm.limits.upper, np.deg2rad([120.0, 80.0]), rtol=1e-14)
    np.testing.assert_array_equal(arm.limits.torque, [50.0, 20.0])
    np.testing.assert_array_equal(arm.armature, [0.1, 0.0])
    np.testing.assert_array_equal(arm.viscous, [0.5, 0.5])
    np.testing.assert_allclose(from_mjcf(GOOD, tip="tool").tip_translation, arm.tip_rotation @ jnp.array([0.2, 0, 0]))


def test_joint_attribute_ref_shifts_the_joint_positions():
    turned = from_mjcf(changed(GOOD, ELBOW, ELBOW.replace("/>", ' ref="30"/>')), tip="tool")
    plain = from_mjcf(GOOD, tip="tool")
    q, at = jnp.array([0.2, 0.1]), jnp.array([0.2, 0.1 - np.deg2rad(30.0)])
    np.testing.assert_allclose(turned.tip(q), plain.tip(at), rtol=1e-13)


@pytest.mark.parametrize(
    ("actuator", "torque"),
    [
        ('<motor joint="elbow" gear="-10" ctrlrange="-1 2"/>', 10.0),
        ('<motor joint="elbow" gear="10" ctrlrange="-2 2" forcerange="-1.5 1.5"/>', 15.0),
        ('<position joint="elbow" kp="100" ctrlrange="-1 1" forcerange="-7 8"/>', 7.0),
        ('<position joint="elbow" kp="100" ctrlrange="-1 1"/>', np.inf),
        ('<motor joint="elbow" ctrlrange="0 3"/><motor joint="elbow" ctrlrange="-4 0"/>', 3.0),
        ("", np.inf),
    ],
)
def test_the_torque_limit_is_that_of_the_actuators(actuator, torque):
    assert float(from_mjcf(changed(GOOD, MOTOR, actuator)).limits.torque[1]) == torque


def test_default_gravity_is_that_of_the_file():
    moon = changed(GOOD, OPTION, '<option gravity="0 0 -1.62"/>')
    np.testing.assert_array_equal(from_mjcf(moon).gravity_vector, [0.0, 0.0, -1.62])
    np.testing.assert_array_equal(from_mjcf(moon, gravity=(0.0, 0.0, -9.8)).gravity_vector, [0.0, 0.0, -9.8])
    off = changed(GOOD, OPTION, '<option><flag gravity="disable"/></option>')
    np.testing.assert_array_equal(from_mjcf(off).gravity_vector, [0.0, 0.0, 0.0])


def test_unsupported_features_of_held_joints_are_ignored():
    spring = changed(GOOD, ELBOW, ELBOW.replace("/>", ' stiffness="3"/>'))
    tied = changed(spring, END, '<equality><joint joint1="elbow"/></equality>' + END)
    arm = from_mjcf(tied, locked={"elbow": 0.5})
    assert arm.joint_names == ("shoulder",)
    assert float(arm.masses[0]) == 3.25


def test_warnings_of_mujoco_are_passed_on():
    twin = changed(GOOD, ELBOW, ELBOW + '<joint name="twin" axis="0 1 0"/>')
    with pytest.warns(UserWarning, match="arm: MuJoCo says: Inertia matrix is too close to singular"):
        assert from_mjcf(twin, locked={"twin": 0.0}).joint_names == ("shoulder", "elbow")


def test_unnamed_parts_get_names_and_a_body_may_have_a_joints_name():
    arm = from_mjcf(changed(GOOD, FORE, '<body pos="0.4 0 0">', 'name="elbow" ', "", MOTOR, ""))
    assert arm.joint_names == ("shoulder", "joint 1") and arm.link_names == ("upper", "body 3")
    arm = from_mjcf(changed(GOOD, FORE, FORE.replace("fore", "elbow")), tip="elbow")
    assert arm.joint_names[1] == arm.link_names[1] == "elbow"


def with_mesh(where: str, name: str) -> str:
    asset = f'<asset><mesh name="hull" file="{name}"/></asset>'
    shape = '<geom type="mesh" mesh="hull"/>'
    text = changed(GOOD, COMPILER, '<compiler angle="degree" meshdir="shapes"/>', WORLD, asset + WORLD)
    return changed(text, SITE, SITE + shape) if where == "next to" else changed(text, INERTIAL, shape)


def test_weightless_mesh_is_neither_required_nor_read(tmp_path):
    (tmp_path / "shapes").mkdir()
    (tmp_path / "shapes" / "hull.stl").write_text("no mesh at all")
    path = tmp_path / "arm.mjcf"
    path.write_text(with_mesh("next to", "hull.stl"))
    np.testing.assert_array_equal(from_mjcf(path, meshes=True).inertias, from_mjcf(GOOD).inertias)
    path.write_text(with_mesh("next to", "lost.stl"))
    with pytest.raises(
        DefinitionError, match=r"body `fore` does not exist; searched .*/shapes/lost\.stl; meshes=False"
    ):
        from_mjcf(path, meshes=True)
    np.testing.assert_array_equal(from_mjcf(path).inertias, from_mjcf(GOOD).inertias)


def test_mesh_that_defines_an_inertia_is_read(tmp_path):
    (tmp_path / "shapes").mkdir()
    (tmp_path / "shapes" / "hull.obj").write_text(TETRAHEDRON)
    path = tmp_path / "arm.xml"
    path.write_text(with_mesh("alone", "hull.obj"))
    arm = from_mjcf(path, meshes=False)
    # A sixth of a cube of 0.1 m with 1000 kg/m³; MuJoCo stores vertices in single precision.
    np.testing.assert_allclose(arm.masses[1], 1000.0 * 0.1**3 / 6.0, rtol=1e-7)
    np.testing.assert_allclose(np.linalg.norm(arm.centers[1]), np.sqrt(3.0) * 0.025, rtol=1e-6)
    path.write_text(with_mesh("alone", "lost.obj"))
    with pytest.raises(DefinitionError, match=r"body `fore` does not exist.*lost\.obj; .* give the body an <inertial>"):
        from_mjcf(path, meshes=False)


def test_an_mjcf_file_may_include_and_attach_others(tmp_path):
    body = GOOD[GOOD.index("<worldbody>") : GOOD.index("</worldbody>") + len("</worldbody>")]
    (tmp_path / "arm.xml").write_text(f"<mujoco>{body}</mujoco>".replace('class="strong" ', ""))
    path = tmp_path / "scene.xml"
    path.write_text('<mujoco><compiler angle="degree"/><include file="arm.xml"/></mujoco>')
    assert from_mjcf(path).joint_names == ("shoulder", "elbow")
    (tmp_path / "part.xml").write_text(changed(GOOD, OPTION, ""))
    attach = '<attach model="arm" body="base" prefix="left-"/>'
    path.write_text(
        f'<mujoco><asset><model name="arm" file="part.xml"/></asset><worldbody><frame pos="0 1 0">{attach}</frame>'
        "</worldbody></mujoco>"
    )
    arm = from_mjcf(path)
    assert arm.joint_names == ("left-shoulder", "left-elbow")
    np.testing.assert_allclose(arm.limits.upper, np.deg2rad([120.0, 80.0]), rtol=1e-14)


def test_nan_in_an_included_file_is_refused(tmp_path, monkeypatch, capfd):
    # MuJoCo would only write a warning to the terminal and to a log in the working directory.
    monkeypatch.chdir(tmp_path)
    body = GOOD[GOOD.index("<worldbody>") : GOOD.index("</worldbody>") + len("</worldbody>")]
    (tmp_path / "arm.xml").write_text(f"<mujoco>{body}</mujoco>".replace('pos="0.4 0 0"', 'pos="nan 0 0"'))
    (tmp_path / "scene.xml").write_text(GOOD.replace(body, '<include file="arm.xml"/>'))
    with pytest.raises(DefinitionError, match=r"scene\.xml: an included file has a number that is NaN"):
        from_mjcf("scene.xml")
    assert capfd.readouterr() == ("", "")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["arm.xml", "scene.xml"]


def test_static_body_stays_the_tip_despite_fusestatic():
    tool = '<body name="tool" pos="0.2 0 0"><geom size="0.01" mass="0.5"/></body>'
    fused = changed(GOOD, COMPILER, '<compiler angle="degree" fusestatic="true"/>', SITE, tool)
    arm = from_mjcf(fused)
    np.testing.assert_array_equal(arm.masses, [2.0, 1.75])
    np.testing.assert_allclose(arm.tip_translation, arm.tip_rotation @ jnp.array([0.2, 0.0, 0.0]))


def test_default_tip_is_the_only_moving_body_without_children():
    scene = from_mjcf(changed(GOOD, WORLD, WORLD + '<body name="table"><geom size="0.1"/></body>'))
    np.testing.assert_array_equal(scene.tip_translation, from_mjcf(GOOD, tip="fore").tip_translation)


def test_file_in_utf_16_is_read(tmp_path):
    (tmp_path / "wide.xml").write_bytes(GOOD.encode("utf-16"))
    np.testing.assert_array_equal(from_mjcf(tmp_path / "wide.xml").inertias, from_mjcf(GOOD).inertias)
