"""No posture of an arm exceeds its constants, and the constants are sharp."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from slidax.arms import Scara, TwoLink, from_urdf, panda, ur5e
from slidax.certify.arm import arm_constants

STATES = 4000


def worst(robot, seed):
    random = np.random.default_rng(seed)
    turns = np.array([unit == "rad" for unit in robot.joint_units])
    q = np.where(
        turns, random.uniform(-np.pi, np.pi, (STATES, robot.joints)), random.uniform(-0.5, 0.5, (STATES, robot.joints))
    )
    dq = random.normal(size=(STATES, robot.joints))
    # C q̇ is quadratic in q̇: at low speeds, rounding would dominate.
    q, dq = jnp.asarray(q), jnp.asarray(dq / np.linalg.norm(dq, axis=1, keepdims=True))
    mass = np.asarray(jax.jit(jax.vmap(robot.mass))(q))
    weight = np.asarray(jax.jit(jax.vmap(robot.gravity))(q))
    bias = np.asarray(jax.jit(jax.vmap(robot.bias))(q, dq))
    values = np.linalg.eigvalsh(mass)
    half = STATES // 2
    apart = np.linalg.norm(np.asarray(q[:half] - q[half:]), axis=1)
    return {
        "largest": values.max(),
        "least": values.min(),
        "weight": np.abs(weight).max(axis=0),
        "mass_slope": (np.linalg.norm(mass[:half] - mass[half:], ord=2, axis=(1, 2)) / apart).max(),
        "weight_slope": (np.linalg.norm(weight[:half] - weight[half:], axis=1) / apart).max(),
        "coriolis": np.linalg.norm(bias - weight, axis=1).max(),
    }


def require_bounded(robot, seed):
    constants, sampled = arm_constants(robot), worst(robot, seed)
    assert constants.inertia_max >= sampled["largest"] * (1 - 1e-12)
    assert 0 <= constants.inertia_min <= sampled["least"] * (1 + 1e-12)
    assert (constants.weight >= sampled["weight"] * (1 - 1e-12) - 1e-12).all()
    assert constants.mass_slope >= sampled["mass_slope"] * (1 - 1e-9) - 1e-9
    assert constants.weight_slope >= sampled["weight_slope"] * (1 - 1e-9) - 1e-9
    assert constants.coriolis >= sampled["coriolis"] * (1 - 1e-9) - 1e-9
    return constants, sampled


def test_inertia_bounds_of_a_two_link_arm_are_exact_within_0_1_percent():
    robot = TwoLink(lengths=[1.0, 0.8], masses=[0.5, 1.5], inertias=[5.0, 5.0], gravity_acceleration=9.8)
    constants, _ = require_bounded(robot, 0)
    mass = np.array([np.asarray(robot.mass(jnp.array([0.0, q]))) for q in np.linspace(0, np.pi, 181)])
    values = np.linalg.eigvalsh(mass)
    assert constants.inertia_max == pytest.approx(values.max(), rel=1e-3)
    assert constants.inertia_min == pytest.approx(values.min(), rel=1e-3)
    # G = [(m1 + m2) l1 g cos q1 + m2 l2 g cos(q1 + q2), ...]
    assert constants.weight == pytest.approx([2.0 * 9.8 + 1.2 * 9.8, 1.2 * 9.8], rel=2e-2)


def test_arm_constants_bound_the_dynamics_of_an_arm_with_a_prismatic_joint_at_random_states():
    robot = Scara(lengths=[1.0, 0.8], masses=[0.5, 1.5, 1.0])
    require_bounded(robot, 1)


@pytest.mark.parametrize(
    "arm", [pytest.param(panda, marks=pytest.mark.full, id="panda"), pytest.param(ur5e, id="ur5e")]
)
def test_arm_constants_bound_the_dynamics_of_a_built_in_arm_at_random_states(arm):
    constants, sampled = require_bounded(arm(), 2)
    assert constants.inertia_max < 1.6 * sampled["largest"]


def test_arm_constants_of_a_gantry_with_constant_inertia_are_exact(tmp_path):
    masses, parts = (8.0, 4.0, 2.0), ['<link name="l0"/>']
    for k, (mass, turn) in enumerate(zip(masses, ("0 1.5708 0", "0 -1.5708 1.5708", "1.5708 0 0"), strict=True), 1):
        parts.append(LINK.format(k=k, c="0 0 0", r="0 0 0", m=mass, i=[0.1] * 3))
        parts.append(JOINT.format(k=k, p=k - 1, kind="prismatic", o="0 0 0", r=turn))
    path = tmp_path / "gantry.urdf"
    path.write_text(f'<robot name="gantry">{"".join(parts)}</robot>')
    constants, _ = require_bounded(from_urdf(path), 3)
    assert (constants.mass_slope, constants.weight_slope, constants.coriolis) == pytest.approx(
        (0.0, 0.0, 0.0), abs=1e-12
    )
    values = np.linalg.eigvalsh(np.asarray(from_urdf(path).mass(jnp.zeros(3))))
    assert (constants.inertia_min, constants.inertia_max) == pytest.approx((values[0], values[-1]))


LINK = """<link name="l{k}"><inertial><origin xyz="{c}" rpy="{r}"/><mass value="{m}"/>
<inertia ixx="{i[0]}" iyy="{i[1]}" izz="{i[2]}" ixy="0" ixz="0" iyz="0"/></inertial></link>"""
JOINT = """<joint name="j{k}" type="{kind}"><parent link="l{p}"/><child link="l{k}"/><origin xyz="{o}" rpy="{r}"/>
<axis xyz="0 0 1"/><limit lower="-.5" upper=".5" effort="10" velocity="1"/></joint>"""


def random_arm(folder, seed):
    """A chain of one to seven joints, one in five of them prismatic."""
    random = np.random.default_rng(seed)
    numbers = lambda low, high: " ".join(f"{x:.4f}" for x in random.uniform(low, high, 3))  # noqa: E731
    parts = ['<link name="l0"/>']
    for k in range(1, int(random.integers(1, 8)) + 1):
        kind = "prismatic" if random.uniform() < 0.2 else "revolute"
        moments = random.uniform(0.01, 0.015, 3)
        parts.append(LINK.format(k=k, c=numbers(-0.1, 0.1), r=numbers(-2, 2), m=random.uniform(0.2, 4.0), i=moments))
        parts.append(JOINT.format(k=k, p=k - 1, kind=kind, o=numbers(-0.4, 0.4), r=numbers(-2, 2)))
    path = folder / f"arm-{seed}.urdf"
    path.write_text(f'<robot name="random">{"".join(parts)}</robot>')
    return from_urdf(path)


@pytest.mark.parametrize("seed", [1, *(pytest.param(k, marks=pytest.mark.full) for k in range(2, 40))])
def test_arm_constants_bound_the_dynamics_of_random_chains_at_random_states(tmp_path, seed):
    require_bounded(random_arm(tmp_path, seed), seed)
