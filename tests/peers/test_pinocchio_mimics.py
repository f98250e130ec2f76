"""Arms whose joints follow others, by slidax and by Pinocchio, which has joints that mimic."""

from __future__ import annotations

import jax
import numpy as np
import pytest

from slidax.arms import from_urdf
from tests.arms.bad_file import changed
from tests.arms.bad_urdf import ANY_LIMIT, END, GOOD, LIMIT, SPARE, joint
from tests.peers.by_pinocchio import pinocchio

WRIST = SPARE + joint(
    "revolute", "wrist", "tool", "spare", '<axis xyz="1 2 0"/>' + ANY_LIMIT + '<origin xyz="0.1 0 0.2" rpy="0.3 0 1"/>'
)
SLIDE = SPARE.replace("spare", "rail") + joint(
    "prismatic",
    "slide",
    "spare",
    "rail",
    '<axis xyz="0 1 1"/>' + ANY_LIMIT + '<mimic joint="elbow" multiplier="0.3" offset="-0.1"/>',
)
ARMS = {
    "an elbow that follows the shoulder": changed(
        GOOD, LIMIT, LIMIT + '<mimic joint="shoulder" multiplier="-0.5" offset="0.2"/>', END, WRIST + END
    ),
    "a slide that follows the elbow": changed(GOOD, END, WRIST + SLIDE + END),
}


@pytest.mark.parametrize("text", ARMS.values(), ids=ARMS)
@pytest.mark.filterwarnings("ignore::slidax.DefinitionWarning")
def test_an_arm_with_followers_moves_as_pinocchio_says(text):
    arm = from_urdf(text, limits=False)
    model = pinocchio.buildModelFromXML(text, mimic=True)
    assert tuple(model.names)[1:] == arm.arm.joint_names
    model.damping = np.zeros(model.nv)
    motion = jax.jit(lambda q, dq: (arm.mass(q), arm.bias(q, dq), arm.gravity(q)))
    for q, dq in np.random.default_rng(5).uniform(-2.0, 2.0, (3, 2, arm.joints)):
        # Its crba adds to what an earlier call left in the rows of leaders.
        data = model.createData()
        mass = np.array(pinocchio.crba(model, data, q))
        mass = np.triu(mass) + np.triu(mass, 1).T
        expected = (mass, pinocchio.nle(model, data, q, dq), pinocchio.computeGeneralizedGravity(model, data, q))
        for one, other in zip(motion(q, dq), expected, strict=True):
            np.testing.assert_allclose(one, other, rtol=0, atol=1e-11 * np.linalg.norm(other))
