import re

import jax.numpy as jnp
import numpy as np
import pytest

from slidax import arms
from slidax.arms.arm import Payload
from slidax.core.errors import DefinitionError
from slidax.identify import payload_text

INERTIA = [[0.01, 0.002, -0.001], [0.002, 0.012, 0.003], [-0.001, 0.003, 0.008]]
PAYLOAD = Payload(mass=2.5, center=(0.01, -0.02, 0.07), inertia=np.array(INERTIA))


def numbers(text):
    return [float(word) for word in re.findall(r"-?\d+\.?\d*(?:e-?\d+)?", text)]


def test_universal_robots_reads_the_moments_before_the_products():
    text = payload_text(PAYLOAD, "ur")
    assert text.startswith("set_target_payload(2.5, [0.01, -0.02, 0.07], [")
    assert numbers(text)[4:] == [0.01, 0.012, 0.008, 0.002, -0.001, 0.003]


def test_libfranka_reads_the_matrix_by_columns():
    text = payload_text(PAYLOAD, "franka")
    assert text.startswith("robot.setLoad(2.5, {0.01, -0.02, 0.07}, {") and text.endswith("});")
    assert np.reshape(numbers(text)[4:], (3, 3), order="F").tolist() == INERTIA


def test_a_link_of_urdf_moves_an_arm_as_the_payload_does():
    arm = """<robot name="one"><link name="base"/><joint name="j" type="continuous"><parent link="base"/>
    <child link="a"/><axis xyz="0 1 0"/></joint><link name="a"><inertial><mass value="1"/><inertia ixx="0.01"
    iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>{}</robot>"""
    fixed = '<joint name="f" type="fixed"><parent link="a"/><child link="payload"/></joint>'
    alone = arms.from_urdf(arm.format(""), tip="a")
    carrying = arms.from_urdf(arm.format(payload_text(PAYLOAD, "urdf") + fixed), tip="a")
    x, z = 0.01, 0.07
    more = 2.5 * (x * x + z * z) + 0.012
    q = jnp.zeros(1)
    assert float((carrying.mass(q) - alone.mass(q))[0, 0]) == pytest.approx(more, rel=1e-6)


def test_an_unknown_form_is_refused_with_the_nearest():
    with pytest.raises(DefinitionError, match="unknown form of a payload `frank`; did you mean `franka`"):
        payload_text(PAYLOAD, "frank")
