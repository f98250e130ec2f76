"""Scenes in MJCF: the arm is read, and other objects are left out with a warning."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
import pytest

from slidax import scenarios
from slidax.arms import from_mjcf
from slidax.core.errors import DefinitionError, DefinitionWarning
from slidax.scenarios import draft
from tests.arms.bad_mjcf import GOOD

pytest.importorskip("mujoco")

BOX = '<body name="box" pos="0.6 0 0.1"><freejoint name="loose"/><geom type="box" size=".03 .03 .03" mass=".2"/></body>'
DOOR = '<body name="frame"><body name="door"><joint name="hinge"/><geom type="sphere" size=".1"/></body></body>'
TABLE = '<geom type="plane" size="1 1 .1"/><body name="table"><geom type="box" size="1 1 .1"/></body>'
KEYS = '<keyframe><key name="home" qpos="0.1 0.2 0 0 0 1 0 0 0"/></keyframe>'
SENSORS = '<sensor><framepos objtype="body" objname="box"/><jointpos joint="elbow"/></sensor>'


def scene(*objects: str, more: str = "") -> str:
    return GOOD.replace("  </worldbody>", "".join(objects) + "</worldbody>").replace("</mujoco>", more + "</mujoco>")


def same(arm, alone) -> None:
    q = jnp.array([0.3, -0.7])
    assert arm.joint_names == alone.joint_names == ("shoulder", "elbow")
    np.testing.assert_array_equal(arm.mass(q), alone.mass(q))
    np.testing.assert_array_equal(arm.bias(q, q), alone.bias(q, q))


@pytest.mark.parametrize(
    ("objects", "more", "tip", "named"),
    [
        ([TABLE, BOX], "", None, "`box` is"),
        ([BOX], KEYS + SENSORS, None, "`box` is"),
        ([BOX, BOX.replace('name="box"', 'name="can"').replace("loose", "rolls")], "", "tool", "`box`, `can` are"),
        ([DOOR, BOX], "", "fore", "`frame`, `box` are"),
        ([BOX], '<actuator><motor joint="loose" gear="1 0 0 0 0 0"/></actuator>', None, "`box` is"),
    ],
)
def test_objects_next_to_the_arm_are_dropped_with_a_warning(objects, more, tip, named):
    alone = from_mjcf(GOOD, tip=tip)
    with pytest.warns(DefinitionWarning, match=f"{named} no part of the arm and left out"):
        same(from_mjcf(scene(*objects, more=more), tip=tip), alone)


def test_an_object_that_is_tied_to_the_arm_is_refused():
    tied = scene(BOX, more='<equality><weld name="glue" body1="fore" body2="box"/></equality>')
    with pytest.raises(DefinitionError, match="joint `loose` of body `box` is free"):
        from_mjcf(tied)


def test_scene_with_two_arms_needs_a_tip_and_omits_the_other_arm():
    two = scene(DOOR)
    with pytest.raises(DefinitionError, match="give tip=NAME; fore, door carry no other"):
        from_mjcf(two)
    with pytest.warns(DefinitionWarning, match="`base` is no part of the arm"):
        assert from_mjcf(two, tip="door").joint_names == ("hinge",)


def test_drafted_scenario_of_a_scene_contains_its_arm_only(tmp_path):
    (tmp_path / "scene.xml").write_text(scene(TABLE, BOX), encoding="utf-8")
    drafted = draft(tmp_path / "scene.xml", folder=tmp_path)
    assert "`box` is no part of the arm and left out" in drafted.notes
    (tmp_path / "scene.yaml").write_text(drafted.text, encoding="utf-8")
    with pytest.warns(DefinitionWarning, match="`box` is no part of the arm"):
        assert scenarios.load(tmp_path / "scene.yaml").plant.robot.joint_names == ("shoulder", "elbow")
