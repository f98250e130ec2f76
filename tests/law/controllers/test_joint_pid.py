import jax.numpy as jnp
import numpy as np
import pytest

from slidax import scenarios
from slidax.core.types import Reference, State
from tests.paper_examples import TWO_LINK_NOMINAL
from tests.rivals import pid_4_1

KP, KI, KD = 200.0, 300.0, 50.0


def asked(law, q, dq, z):
    reference = Reference(q=[0.0, 0.0])
    return law(jnp.zeros(()), State(q=q, dq=dq), reference, reference, jnp.asarray(z))


def test_it_is_the_textbooks_law():
    q, dq, z = jnp.array([0.1, -0.2]), jnp.array([0.3, 0.4]), jnp.array([-0.05, 0.02])
    answer = asked(pid_4_1(kp=KP, ki=KI, kd=KD), q, dq, z)
    np.testing.assert_allclose(answer.tau, -KP * q - KD * dq - KI * z, rtol=1e-14)
    np.testing.assert_array_equal(answer.rate, q)
    heavy = asked(pid_4_1(kp=KP, ki=KI, kd=KD, gravity=0.5), q, dq, z)
    np.testing.assert_allclose(heavy.tau - answer.tau, 0.5 * TWO_LINK_NOMINAL.gravity(q), rtol=1e-12)


def test_beyond_the_limit_the_integral_of_that_joint_stands_still_unless_it_comes_back():
    law = pid_4_1(kp=KP, ki=KI, kd=KD, limit=[10.0, 100.0])
    e = jnp.array([0.1, 0.1])
    np.testing.assert_array_equal(asked(law, e, jnp.zeros(2), [0.0, 0.0]).rate, [0.0, 0.1])
    # The integral has wound up the other way: the error unwinds it, at the limit as well.
    np.testing.assert_array_equal(asked(law, e, jnp.zeros(2), [-1.0, 0.0]).rate, [0.1, 0.1])


@pytest.mark.parametrize("sampled", [None, {}], ids=["as printed", "sampled-data"])
def test_after_a_long_time_at_the_drives_limit_it_does_not_overshoot(sampled):
    """1 rad away, with drives of 12 N m for an arm that takes 8 N m s² to speed up a radian: a second at the limit."""
    changes = {
        "scheme.name": "pid",
        "scheme.sampled_data": sampled,
        "trajectory": {"kind": "constant", "value": [0.0, 0.0]},
        "start": {"q": [1.0, -1.0]},
        "actuator.torque": 12.0,
        "robot.plant.gravity_acceleration": 0.0,
        "disturbance.scale": 0.0,
        "simulation.t1": 4.0,
        **{f"scheme.{name}": value for name, value in (("kp", 200.0), ("ki", 300.0), ("kd", 100.0))},
    }
    scenario = scenarios.load("example-4.1-1khz", changes)
    winding = scenarios.load("example-4.1-1khz", {**changes, "scheme.limit": 1e9, "scheme.sampled_data": None})
    runs = [one.simulate(progress=False) for one in (scenario, winding)]
    past = [np.abs(run.log.e * (np.sign(run.log.e) != [1.0, -1.0])).max() for run in runs]
    assert past[0] < 0.5 * past[1] and runs[0].outcome.ok
