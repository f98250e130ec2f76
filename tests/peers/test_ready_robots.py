"""Dynamics of the built-in arms against Pinocchio, MuJoCo and published models of the same arms."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from functools import cache

import numpy as np
import pytest

from slidax.arms import Articulated, built_in_arm, built_in_names, from_urdf
from tests.peers.arms import ARMS
from tests.peers.by_mujoco import by_mujoco
from tests.peers.by_pinocchio import by_pinocchio
from tests.peers.motion import Motion, States, assert_same, by_slidax, random_states
from tests.peers.ready_arms import DESCRIPTIONS, for_mujoco, for_pinocchio


@cache
def arm(name: str) -> Articulated:
    return built_in_arm(name).robot


@cache
def moved(name: str) -> tuple[States, Motion]:
    states = random_states(arm(name), 100)
    return states, by_slidax(arm(name), states)


def tip_of(name: str) -> str:
    return DESCRIPTIONS[name]["tip"]["name"]


@pytest.mark.parametrize(
    ("by_peer", "model_of"), [(by_pinocchio, for_pinocchio), (by_mujoco, for_mujoco)], ids=["pinocchio", "mujoco"]
)
@pytest.mark.parametrize("name", built_in_names())
def test_dynamics_of_a_built_in_arm_agree_with_pinocchio_and_mujoco(name, by_peer, model_of):
    states, ours = moved(name)
    assert_same(ours, by_peer(model_of(name), tip_of(name), arm(name).joint_names, states))


def without_the_hand(text: str, tip: str) -> str:
    """The URDF up to the flange, with exact right angles in place of the file's 1.5708."""
    tree = ElementTree.fromstring(text.replace("1.5708 ", f"{np.pi / 2!r} "))
    joints = {joint.find("child").get("link"): joint for joint in tree.iter("joint") if joint.find("child") is not None}
    carried, link = {tip}, tip
    while link in joints:
        link = joints[link].find("parent").get("link")
        carried.add(link)
    for child, joint in joints.items():
        if child not in carried:
            tree.remove(joint)
    for body in tree.findall("link"):
        if body.get("name") not in carried:
            tree.remove(body)
    return ElementTree.tostring(tree, encoding="unicode")


@pytest.mark.parametrize(("name", "file"), [("panda", "panda.urdf"), ("xarm7", "xarm7.urdf")])
def test_a_built_in_arm_moves_like_the_urdf_of_example_robot_data(name, file):
    path = next(other.path for other in ARMS if other.name == file)
    with open(path, encoding="utf-8") as opened:
        text = without_the_hand(opened.read(), tip_of(name))
    other = from_urdf(text, tip=tip_of(name), meshes=False)
    assert other.joint_names == arm(name).joint_names
    states, ours = moved(name)
    assert_same(ours, by_slidax(other, states))


def test_inertia_gravity_and_coriolis_forces_of_the_gen3_agree_with_published_closed_forms():
    """Formulas of pyKinovaGen3, derived by computer algebra; its tip position has fewer digits."""
    pytest.importorskip("kinova_gen3")
    from kinova_gen3.dynamics.coriolis import coriolis
    from kinova_gen3.dynamics.gravity import gravity
    from kinova_gen3.dynamics.mass_matrix import mass_matrix
    from kinova_gen3.kinematics.forward_kinematics import forward_kinematics

    states, ours = moved("gen3")
    share = 9.81 / 9.80665
    for q, dq, mass, bias, held, tip in zip(*states[:2], ours.mass, ours.bias, ours.gravity, ours.tip, strict=True):
        np.testing.assert_allclose(mass, mass_matrix(q), rtol=0, atol=1e-12)
        np.testing.assert_allclose(held, gravity(q) * share, rtol=0, atol=1e-10)
        np.testing.assert_allclose(bias, coriolis(q, dq) + gravity(q) * share, rtol=0, atol=1e-10)
        np.testing.assert_allclose(tip, forward_kinematics(q)[0], rtol=0, atol=1e-4)
