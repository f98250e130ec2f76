import ast
import json
import re

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from slidax import arms
from slidax.arms.arm import Payload
from slidax.core.errors import DefinitionError
from slidax.identify import payload_text

INERTIA = [[0.01, 0.002, -0.001], [0.002, 0.012, 0.003], [-0.001, 0.003, 0.008]]
PAYLOAD = Payload(mass=2.5, center=(0.01, -0.02, 0.07), inertia=np.array(INERTIA))


def numbers(text):
    return [float(word) for word in re.findall(r"-?\d+\.?\d*(?:e-?\d+)?", text)]


def test_payload_text_for_universal_robots_has_moments_before_products_of_inertia():
    text = payload_text(PAYLOAD, "ur")
    assert text.startswith("set_target_payload(2.5, [0.01, -0.02, 0.07], [")
    assert numbers(text)[4:] == [0.01, 0.012, 0.008, 0.002, -0.001, 0.003]


def test_payload_text_for_libfranka_has_all_nine_entries_of_the_inertia():
    text = payload_text(PAYLOAD, "franka")
    assert text.startswith("robot.setLoad(2.5, {0.01, -0.02, 0.07}, {") and text.endswith("});")
    assert np.reshape(numbers(text)[4:], (3, 3)).tolist() == INERTIA


def test_payload_file_for_franka_desk_has_mass_center_inertia_and_the_flange_as_tool_frame():
    file = json.loads(payload_text(PAYLOAD, "desk"))
    assert file["mass"] == 2.5 and file["centerOfMass"] == [0.01, -0.02, 0.07]
    assert np.reshape(file["inertia"], (3, 3)).tolist() == INERTIA
    assert np.reshape(file["transformation"], (4, 4)).tolist() == np.eye(4).tolist()


def read_krl(text):
    """Mass, centre [m] and inertia of a LOAD_DATA, whose angles A, B, C turn about Z, Y and X."""
    value = re.sub(r"([A-Z]+) (?=[-{\d])", r"'\1': ", text.split("=", 1)[1])
    load = ast.literal_eval(value)
    center, moments = load["CM"], [load["J"][axis] for axis in "XYZ"]
    turned = np.eye(3)
    for name, axis in zip("ABC", np.eye(3)[::-1], strict=True):
        turned = turned @ Rotation.from_rotvec(np.deg2rad(center[name]) * axis).as_matrix()
    return load["M"], [center[axis] / 1e3 for axis in "XYZ"], turned @ np.diag(moments) @ turned.T


def random_payload(seed):
    random = np.random.default_rng(seed)
    points = random.normal(size=(20, 3)) * random.uniform(0.01, 0.1, 3)
    spread = points.T @ points / 20
    return Payload(
        mass=random.uniform(0.2, 5),
        center=random.uniform(-0.1, 0.1, 3),
        inertia=np.trace(spread) * np.eye(3) - spread,
    )


@pytest.mark.parametrize("seed", range(20))
def test_payload_text_for_kuka_has_principal_moments_and_the_angles_of_their_axes(seed):
    payload = random_payload(seed)
    mass, center, inertia = read_krl(payload_text(payload, "kuka"))
    assert mass == pytest.approx(float(payload.mass), rel=1e-5)
    np.testing.assert_allclose(center, payload.center, rtol=1e-5)
    np.testing.assert_allclose(inertia, payload.inertia, atol=1e-5 * np.max(np.abs(payload.inertia)))


def test_pinocchio_reads_mass_center_and_inertia_of_the_payload_urdf():
    pinocchio = pytest.importorskip("pinocchio")
    text = payload_text(PAYLOAD, "urdf")
    model = pinocchio.buildModelFromXML(
        f"""<robot name="r"><link name="base"/>{text}<joint name="j" type="revolute"><parent link="base"/>
        <child link="payload"/><axis xyz="0 0 1"/><limit effort="1" velocity="1" lower="-1" upper="1"/></joint>
        </robot>"""
    )
    body = model.inertias[1]
    assert body.mass == 2.5
    np.testing.assert_allclose(body.lever, PAYLOAD.center, rtol=1e-12)
    np.testing.assert_allclose(body.inertia, INERTIA, rtol=1e-9)


def test_a_payload_link_in_urdf_adds_the_payloads_inertia_to_the_arm():
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


def test_an_unknown_payload_form_is_refused_with_the_nearest_known_form():
    with pytest.raises(DefinitionError, match="unknown payload format `frank`; did you mean `franka`"):
        payload_text(PAYLOAD, "frank")
