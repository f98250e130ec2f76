import jax.numpy as jnp
import numpy as np
import pytest

from slidax import scenarios
from slidax.export.web.playground import arm_entry

SCENARIOS = ("example-4.1-1khz", "example-4.2-1khz", "panda-payload")


def drawn(name):
    scenario = scenarios.load(name)
    limits = np.inf, np.inf
    return scenario, arm_entry(scenario.plant.robot, "arm", "Arm", *limits, scenario.trajectory, scenario.t1)


def turned(quaternion):
    w, x, y, z = quaternion
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def frames(arm, q):
    result = []
    for link in arm["kinematics"]:
        turn, place = (np.eye(3), np.zeros(3)) if link["parent"] < 0 else result[link["parent"]]
        place, turn = place + turn @ np.array(link["origin"][:3]), turn @ turned(link["origin"][3:])
        angle = q[link["joint"]]
        if link["type"] == "prismatic":
            place = place + turn @ np.array(link["axis"]) * angle
        else:
            c, s = np.cos(angle), np.sin(angle)
            turn = turn @ np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        result.append((turn, place))
    return result


@pytest.mark.parametrize("name", SCENARIOS)
def test_the_drawn_tip_is_at_the_position_of_forward_kinematics(name):
    scenario, arm = drawn(name)
    for seed in range(3):
        q = np.random.default_rng(seed).uniform(-1.0, 1.0, scenario.state0.q.size)
        turn, place = frames(arm, q)[arm["tip"]["link"]]
        tip = place + turn @ np.array(arm["tip"]["at"])
        np.testing.assert_allclose(tip, scenario.plant.robot.tip(jnp.asarray(q)), atol=1e-6)


def test_the_drawn_rod_of_a_prismatic_joint_is_longer_than_its_travel():
    scenario, arm = drawn("example-4.2-1khz")
    (slides,) = [k for k, link in enumerate(arm["kinematics"]) if link["type"] == "prismatic"]
    (rod,) = [s for s in arm["shapes"] if s["link"] == slides and s["kind"] == "capsule"]
    times = np.linspace(0.0, scenario.t1, 40)
    farthest = max(abs(float(scenario.trajectory.position(jnp.asarray(t))[2])) for t in times)
    assert rod["size"][1] > farthest and rod["at"][2] == pytest.approx(-0.5 * rod["size"][1])
