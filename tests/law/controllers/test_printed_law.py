"""The law of the paper against an independent transcription, and in the cases where its value is plain."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from slidax.core.types import Reference, State
from slidax.law import Exponential
from tests.arms.test_closed_forms import scara, two_link
from tests.law.controllers.transcription import TABLE_1, TABLE_2, torque
from tests.paper_examples import SCARA, TWO_LINK_NOMINAL, law_4_1, law_4_2


def matrices_4_1(q, dq):
    return two_link(1.0, 0.8, 0.6, 1.8, 6.0, 6.0, 9.8, q, dq)


def matrices_4_2(q, dq):
    return scara(0.3, 0.4, 2.0, 2.0, 1.0, 9.8, q, dq)


LAWS = [
    pytest.param(law_4_1, TABLE_1, matrices_4_1, id="example_4_1"),
    pytest.param(law_4_2, TABLE_2, matrices_4_2, id="example_4_2"),
]


@jax.jit
def command(controller, t, e0, state, reference):
    start = State(q=e0, dq=jnp.zeros_like(e0))
    origin = Reference(q=jnp.zeros_like(e0), dq=jnp.zeros_like(e0), ddq=jnp.zeros_like(e0))
    memory = controller.init(jnp.zeros(()), start, origin)
    return controller(t, state, reference, reference, memory)


@pytest.mark.parametrize("layer", [0.0, 0.05])
@pytest.mark.parametrize(("law", "gains", "matrices"), LAWS)
def test_the_torque_is_the_printed_one_at_random_states_inside_the_envelope(law, gains, matrices, layer):
    controller, gains = law(layer=layer), gains._replace(s0=layer)
    rng = np.random.default_rng(0)
    n = len(gains.T)
    for _ in range(200):
        t = rng.uniform(0.0, 9.0)
        e0 = rng.choice([-0.5, 0.5], n)
        rho = (gains.rho0 - gains.rho_inf) * np.maximum(1 - t / gains.T, 0.0) ** 2.01 + gains.rho_inf
        b, b_bar = np.where(e0 >= 0, -0.2, -1.0), np.where(e0 >= 0, 1.0, 0.2)
        share = rng.uniform(0.02, 0.98, n) if rng.uniform() < 0.7 else 0.2 / 1.2 + rng.normal(size=n) * 1e-3
        share = np.where(e0 >= 0, share, 1 - share)
        e = (b + share * (b_bar - b)) * rho
        qd, dqd, ddqd = rng.normal(size=(3, n))
        q, dq = qd + e, dqd + rng.normal(size=n)
        tau, s, eps1, eps2, u = torque(gains, t, e0, q, dq, qd, dqd, ddqd, matrices)
        given = command(
            controller,
            jnp.asarray(t),
            jnp.asarray(e0),
            State(q=jnp.asarray(q), dq=jnp.asarray(dq)),
            Reference(q=jnp.asarray(qd), dq=jnp.asarray(dqd), ddq=jnp.asarray(ddqd)),
        )
        scale = np.abs(tau).max()
        # e = q - q_d loses digits where the envelope is narrow: 1e-16/rho relative.
        tolerance = 1e-11 + 1e-14 / rho.min()
        np.testing.assert_allclose(given.signals["eps1"], eps1, rtol=1e3 * tolerance, atol=1e2 * tolerance)
        np.testing.assert_allclose(given.signals["eps2"], eps2, rtol=0, atol=1e2 * tolerance * np.abs(eps2).max())
        np.testing.assert_allclose(given.signals["s"], s, rtol=0, atol=1e2 * tolerance * np.abs(s).max())
        np.testing.assert_allclose(given.signals["u"], u, rtol=1e2 * tolerance)
        np.testing.assert_allclose(given.tau, tau, rtol=0, atol=1e2 * tolerance * scale)


@pytest.mark.parametrize("layer", [0.0, 0.05])
@pytest.mark.parametrize(
    ("controller", "robot", "n"),
    [pytest.param(law_4_1, TWO_LINK_NOMINAL, 2, id="two_link"), pytest.param(law_4_2, SCARA, 3, id="scara")],
)
@pytest.mark.parametrize("t", [0.0, 1.0, 8.0])
def test_without_any_error_the_torque_is_the_computed_torque_of_the_nominal_arm(controller, robot, n, layer, t):
    """At e = ė = 0 the law is `M0 q̈_d + C0 q̇ + G0` at any time: A and Ȧ multiply e and ė, and s is zero."""
    rng = np.random.default_rng(1)
    q, dq, ddq = (jnp.asarray(x) for x in rng.normal(size=(3, n)))
    reference = Reference(q=q, dq=dq, ddq=ddq)
    given = command(controller(layer=layer), jnp.asarray(t), 0.3 * jnp.ones(n), State(q=q, dq=dq), reference)
    expected = robot.mass(q) @ ddq + robot.coriolis(q, dq) @ dq + robot.gravity(q)
    np.testing.assert_allclose(given.tau, expected, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(given.signals["s"], 0.0, atol=1e-14)


def test_the_first_torque_of_example_4_1_is_the_one_of_the_papers_figure():
    from tests.paper_examples import MOTION_4_1, START_4_1

    reference = MOTION_4_1.reference(jnp.zeros(()))
    given = command(law_4_1(), jnp.zeros(()), START_4_1.q - reference.q, START_4_1, reference)
    np.testing.assert_allclose(given.tau, [103.653, -97.039], rtol=1e-5)


def test_a_matrix_of_reaching_gains_acts_as_its_product():
    gain = np.array([[0.5, 0.2], [0.2, 0.3]])
    state = State(q=jnp.array([0.3, 0.2]), dq=jnp.array([0.1, -0.2]))
    reference = Reference(q=jnp.zeros(2), dq=jnp.zeros(2), ddq=jnp.zeros(2))

    def tau(k0):
        return command(law_4_1(gain=k0), jnp.asarray(1.0), state.q, state, reference)

    diagonal, full = tau([0.5, 0.3]), tau(gain)
    s = np.asarray(full.signals["s"])
    sig = np.abs(s) ** 1.2 * np.sign(s)
    np.testing.assert_allclose(tau(np.diag([0.5, 0.3])).tau, diagonal.tau, rtol=1e-14)
    du = float(full.signals["u"] - diagonal.signals["u"])
    direction = s / (np.linalg.norm(s) + 0.05)
    expected = -(gain - np.diag([0.5, 0.3])) @ sig - du * direction
    np.testing.assert_allclose(full.tau - diagonal.tau, expected, rtol=1e-10, atol=1e-12)


def test_another_performance_function_fits_the_same_law():
    controller = law_4_1(performance=Exponential([0.8, 0.6], 0.002, 1.0))
    memory = controller.init(jnp.zeros(()), State(q=jnp.ones(2), dq=jnp.ones(2)), Reference(*jnp.zeros((3, 2))))
    envelope = controller.envelope(jnp.asarray(1.0), memory)
    rho = np.array([0.798, 0.598]) * np.exp(-1.0) + 0.002
    np.testing.assert_allclose(envelope.upper, rho, rtol=1e-14)
    np.testing.assert_allclose(envelope.lower, -0.2 * rho, rtol=1e-14)
