"""The schemes that the paper compares with, against plain transcriptions of their equations."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from slidax.core.types import Reference, State
from slidax.law import Linear
from tests.law.controllers import rival_transcription as printed
from tests.law.controllers.test_printed_law import matrices_4_1, matrices_4_2
from tests.law.controllers.transcription import TABLE_1, torque
from tests.paper_examples import MOTION_4_1, MOTION_4_2, START_4_1, START_4_2
from tests.rivals import (
    AROUND_4_1,
    AROUND_4_2,
    anftsmc_4_2,
    computed_torque_4_1,
    ftsmc_4_1,
    ftsmppc_4_1,
    gravity_pd_4_1,
    nftsmc_4_2,
    sfsmc_4_2,
    slotine_li_4_1,
    super_twisting_4_2,
)


@eqx.filter_jit
def command(controller, memory, q, dq, reference):
    return controller(jnp.zeros(()), State(q=q, dq=dq), reference, reference, memory)


def random_states(n, seed=0, count=60):
    """States and references: far off, near, and on the reference with one joint or with all of them."""
    rng = np.random.default_rng(seed)
    for i in range(count):
        qd, dqd, ddqd = rng.normal(size=(3, n))
        e, de = rng.normal(size=(2, n)) * [1.0, 1e-2, 1e-4, 0.3][i % 4]
        if i % 4 == 3:
            e[rng.integers(n)] = 0.0
            de[rng.integers(n)] = 0.0
        yield qd + e, dqd + de, qd, dqd, ddqd


def given(controller, memory, q, dq, qd, dqd, ddqd):
    reference = Reference(q=jnp.asarray(qd), dq=jnp.asarray(dqd), ddq=jnp.asarray(ddqd))
    return command(controller, memory, jnp.asarray(q), jnp.asarray(dq), reference)


def agree(found, wanted, tau):
    np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-10 * (1 + np.abs(tau).max()))


@pytest.mark.parametrize("layer", [0.0, 0.05])
@pytest.mark.parametrize(
    ("law", "transcription", "matrices", "n"),
    [
        pytest.param(ftsmc_4_1, printed.ftsmc, matrices_4_1, 2, id="ftsmc"),
        pytest.param(sfsmc_4_2, printed.sfsmc, matrices_4_2, 3, id="sfsmc"),
        pytest.param(nftsmc_4_2, printed.nftsmc, matrices_4_2, 3, id="nftsmc"),
    ],
)
def test_the_torque_is_that_of_the_equations(law, transcription, matrices, n, layer):
    controller = law(layer=layer)
    for state in random_states(n):
        tau, s, u = transcription(*state, matrices, layer)
        answer = given(controller, (), *state)
        agree(answer.signals["s"], s, 0.0)
        agree(answer.signals["u"], u, tau)
        agree(answer.tau, tau, tau)


def test_ftsmppc_is_the_printed_law_with_the_older_power(monkeypatch):
    """Outside the core the two powers are one; inside, the transcription's cubic becomes a straight line."""
    rng = np.random.default_rng(0)
    zero = jnp.zeros(())
    for i in range(60):
        qd, dqd, ddqd, dq = rng.normal(size=(4, 2))
        e0 = np.array([-0.6, 0.5])
        e = rng.uniform([-0.7, -0.1], [0.1, 0.5]) if i % 2 else rng.normal(size=2) * 1e-3
        tau, s, eps1, _, _ = torque(TABLE_1._replace(s0=0.05), 0.0, e0, qd + e, dq, qd, dqd, ddqd, matrices_4_1)
        origin = Reference(*jnp.zeros((3, 2)))
        controller = ftsmppc_4_1()
        memory = controller.init(zero, State(q=jnp.asarray(e0), dq=jnp.zeros(2)), origin)
        answer = given(controller, memory, qd + e, dq, qd, dqd, ddqd)
        if np.all(np.abs(eps1) > 0.01):
            agree(answer.signals["s"], s, 0.0)
            agree(answer.tau, tau, tau)
            continue
        near, _ = printed.hat_power(eps1, 0.5, 0.01)
        l1, l2, l3 = 1.875 * 0.01**-0.5, -1.25 * 0.01**-1.5, 0.375 * 0.01**-2.5
        cubic = [v if abs(x) >= 0.01 else l1 * x + l2 * abs(x) * x + l3 * x**3 for x, v in zip(eps1, near, strict=True)]
        np.testing.assert_allclose(answer.signals["s"], s + 0.2 * (near - np.array(cubic)), rtol=1e-9, atol=1e-11)


def test_anftsmc_and_its_rate_are_those_of_the_equations():
    controller, b = anftsmc_4_2(), np.array([0.3, 0.2, 0.1])
    for state in random_states(3):
        tau, s, size, rate = printed.anftsmc(*state, matrices_4_2, b)
        answer = given(controller, jnp.asarray(b), *state)
        agree(answer.signals["s"], s, 0.0)
        agree(answer.signals["u"], size, 0.0)
        agree(answer.tau, tau, tau)
        agree(answer.rate, rate, rate)
        np.testing.assert_array_equal(answer.memory, b)


@pytest.mark.parametrize("layer", [0.0, 0.05])
def test_slotine_li_is_the_textbooks_law(layer):
    controller = slotine_li_4_1(layer=layer)
    for state in random_states(2):
        tau, s = printed.slotine_li(*state, matrices_4_1, layer)
        answer = given(controller, (), *state)
        agree(answer.signals["s"], s, 0.0)
        agree(answer.tau, tau, tau)


def test_super_twisting_and_its_rate_are_those_of_the_equations():
    controller, v = super_twisting_4_2(), np.array([1.0, -2.0, 0.5])
    start = controller.init(jnp.zeros(()), START_4_2, MOTION_4_2.reference(jnp.zeros(())))
    np.testing.assert_array_equal(start.v, 0.0)
    for state in random_states(3):
        tau, s, rate = printed.super_twisting(*state, matrices_4_2, v)
        answer = given(controller, eqx.tree_at(lambda m: m.v, start, jnp.asarray(v)), *state)
        agree(answer.signals["s"], s, 0.0)
        agree(answer.tau, tau, tau)
        moving = np.abs(s) > 1e-12
        np.testing.assert_array_equal(answer.rate.v[moving], rate[moving])


def test_computed_torque_and_gravity_pd_are_the_textbooks_laws():
    for q, dq, qd, dqd, ddqd in random_states(2):
        M0, C0, G0 = matrices_4_1(q, dq)
        e, de = q - qd, dq - dqd
        tau = M0 @ (ddqd - [90.0, 100.0] * e - 20.0 * de) + C0 @ dq + G0
        agree(given(computed_torque_4_1(kp=[90.0, 100.0]), (), q, dq, qd, dqd, ddqd).tau, tau, tau)
        tau = G0 - 400.0 * e - [90.0, 100.0] * de
        agree(given(gravity_pd_4_1(kd=[90.0, 100.0]), (), q, dq, qd, dqd, ddqd).tau, tau, tau)


ENVELOPED = [
    pytest.param(slotine_li_4_1(AROUND_4_1, Linear(0.6)), MOTION_4_1, START_4_1, id="slotine_li"),
    pytest.param(super_twisting_4_2(AROUND_4_2, Linear(0.6)), MOTION_4_2, START_4_2, id="super_twisting"),
]


@pytest.mark.parametrize(("controller", "trajectory", "start"), ENVELOPED)
def test_inside_an_envelope_the_equivalent_control_holds_the_surface(controller, trajectory, start):
    """On the surface, where the robust parts are zero, the law makes `ṡ = 0` on the exact arm; ṡ along the motion."""
    memory = controller.init(jnp.zeros(()), start, trajectory.reference(jnp.zeros(())))
    arm = controller.nominal

    def ask(t, state):
        reference = trajectory.reference(t)
        return controller(t, state, reference, reference, memory)

    def s_of(t, state):
        return ask(t, state).signals["s"]

    def ds(t, q, dq):
        # The velocity that puts the state on the surface: s is ė plus what depends on the position.
        dq = dq - s_of(t, State(q=q, dq=dq))
        state = State(q=q, dq=dq)
        rate = State(q=dq, dq=arm.acceleration(state, ask(t, state).tau))
        return jax.jvp(s_of, (t, state), (jnp.ones(()), rate))

    rng = np.random.default_rng(1)
    evaluate = jax.jit(ds)
    for _ in range(20):
        t = jnp.asarray(rng.uniform(0.0, 3.0))
        envelope = controller.envelope(t, memory)
        e = envelope.lower + rng.uniform(0.1, 0.9, arm.joints) * (envelope.upper - envelope.lower)
        s, change = evaluate(t, trajectory.position(t) + e, jnp.asarray(rng.normal(size=arm.joints)))
        np.testing.assert_allclose(s, 0.0, atol=1e-13)
        # What is left is the robust part of a rounding error in s, 12 √1e-15 for super-twisting.
        np.testing.assert_allclose(change, 0.0, atol=1e-6)
