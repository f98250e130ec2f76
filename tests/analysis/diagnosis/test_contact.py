"""A force at the tip that comes at once: something that it met, or what it carries."""

from types import SimpleNamespace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from slidax.analysis.torque_causes import ContactCause
from slidax.arms import panda

PERIOD = 2e-3
LEFT = 800


@pytest.fixture(scope="module")
def swung():
    """A Panda whose motion becomes ten times as fast at t = 1.4 s, and its tip's Jacobians and accelerations."""
    robot = panda()
    t = PERIOD * np.arange(1000)
    swing = 0.02 * np.sin(t) + np.where(t > 1.4, 0.1 * (1.0 - np.cos(10.0 * (t - 1.4))), 0.0)
    q = np.array([0.0, -0.3, 0.0, -2.0, 0.0, 1.7, 0.5]) + swing[:, None] * np.array([0, 1.0, 0, 1, 0, -1, 0])
    tips = np.asarray(jax.vmap(robot.tip)(jnp.asarray(q)))
    accelerations = np.gradient(np.gradient(tips, PERIOD, axis=0), PERIOD, axis=0)
    jacobians = np.asarray(jax.vmap(jax.jacfwd(robot.tip))(jnp.asarray(q)))
    return robot, t, q, jacobians, accelerations


def finding(swung, force):
    """Of a run on which the law's model lacks what a force on the tip asks of the drives."""
    robot, t, q, jacobians, _ = swung
    record = SimpleNamespace(
        nominal=robot,
        joints=7,
        period=PERIOD,
        left=LEFT,
        t=t,
        q=q,
        unexplained=-np.einsum("kij,ki->kj", jacobians, force),
        scenario=SimpleNamespace(description=SimpleNamespace(surroundings=SimpleNamespace(table=None))),
    )
    return ContactCause().finding(record)


def test_a_force_that_comes_at_once_is_a_contact(swung):
    force = np.where(swung[1][:, None] > 1.5, np.array([0.0, 0.0, 30.0]), 0.0)
    found = finding(swung, force)
    assert found is not None
    assert found.numbers["force"] == pytest.approx(30.0, rel=0.05)


def test_payload_inertia_in_a_sudden_motion_is_no_contact(swung):
    assert finding(swung, -3.0 * swung[4]) is None


def test_force_of_a_payload_heavier_than_the_arm_is_a_contact(swung):
    assert finding(swung, -300.0 * swung[4]) is not None
