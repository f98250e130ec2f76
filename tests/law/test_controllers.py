"""Controllers: equations against independent transcriptions, and the loop closed over the exact model."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from slidax import scenarios
from slidax.core.types import Reference, State
from slidax.law import Exponential, Linear, SlidingMode, TwoPowerReaching
from tests.arms.test_closed_forms import scara, two_link
from tests.enrolled import every
from tests.law import transcription as printed
from tests.law.members import CONTROLLERS, CONTROLLERS_LIKE_OTHERS, Case
from tests.law.transcription import TABLE_1, TABLE_2, torque
from tests.paper_examples import MOTION_4_1, MOTION_4_2, START_4_1, START_4_2, TWO_LINK_NOMINAL, law_4_1, law_4_2
from tests.rivals import (
    AROUND_4_1,
    AROUND_4_2,
    anftsmc_4_2,
    computed_torque_4_1,
    ftsmc_4_1,
    ftsmppc_4_1,
    gravity_pd_4_1,
    nftsmc_4_2,
    pid_4_1,
    sfsmc_4_2,
    slotine_li_4_1,
    super_twisting_4_2,
)

SLIDING = [(name, case) for name, case in CONTROLLERS if isinstance(case.controller, SlidingMode)]


def exact(case: Case) -> Case:
    """The same case with a law that knows the true arm."""
    return case._replace(controller=eqx.tree_at(lambda c: c.nominal, case.controller, case.robot))


def power(reaching, s):
    """K0 Sig^r(s) of (43), or K1 Sig^v1(s) + K2 Sig^v2(s) of [24]."""
    if isinstance(reaching, TwoPowerReaching):
        signed = [jnp.abs(s) ** v * jnp.sign(s) for v in (reaching.v1, reaching.v2)]
        return reaching.k1 * signed[0] + reaching.k2 * signed[1]
    return reaching.gain * jnp.abs(s) ** reaching.exponent * jnp.sign(s)


@every("case", SLIDING, full=CONTROLLERS_LIKE_OTHERS)
def test_sliding_variable_obeys_the_reaching_law_with_the_exact_model(case):
    """(54): `M ṡ = -K0 Sig^r(s) - u s/(‖s‖ + s0)`, or with the powers of [24]; ṡ is taken along the true motion."""
    controller, robot, trajectory, start, _ = exact(case)
    memory = controller.init(jnp.zeros(()), start, trajectory.reference(jnp.zeros(())))

    def command(t, state):
        reference = trajectory.reference(t)
        return controller(t, state, reference, reference, memory)

    @jax.jit
    def both_sides(t, share, de):
        envelope, reference = controller.envelope(t, memory), trajectory.reference(t)
        e = share - 0.5 if envelope is None else envelope.lower + share * (envelope.upper - envelope.lower)
        state = State(q=reference.q + e, dq=reference.dq + de)
        now = command(t, state)
        rate = State(q=state.dq, dq=robot.acceleration(state, now.tau))
        _, ds = jax.jvp(lambda t, y: command(t, y).signals["s"], (t, state), (jnp.ones(()), rate))
        s, u = now.signals["s"], now.signals["u"]
        wanted = -power(controller.reaching, s) - u * s / (jnp.sqrt(jnp.sum(s * s)) + controller.reaching.layer)
        return robot.mass(state.q) @ ds, wanted, now.tau

    rng = np.random.default_rng(2)
    n = robot.joints
    for _ in range(50):
        left, right, tau = both_sides(
            jnp.asarray(rng.uniform(0.0, 4.0)), jnp.asarray(rng.uniform(0.05, 0.95, n)), jnp.asarray(rng.normal(size=n))
        )
        scale = max(np.abs(right).max(), np.abs(tau).max())
        np.testing.assert_allclose(left, right, rtol=0, atol=1e-10 * scale)


def test_sliding_mode_signals_have_their_names_and_shapes():
    case = dict(CONTROLLERS)["cftsmppc_4_1"]
    reference = case.trajectory.reference(jnp.zeros(()))
    memory = case.controller.init(jnp.zeros(()), case.start, reference)
    signals = case.controller(jnp.zeros(()), case.start, reference, reference, memory).signals
    assert [signals[name].shape for name in ("s", "eps1", "eps2", "u")] == [(2,), (2,), (2,), ()]


def test_the_preset_has_the_defaults_of_table_1():
    named = law_4_1(gain=0.1, k1=0.2, k2=0.6, p=0.5, q=1.2, exponent=1.2, delta=0.01, layer=0.05)
    for default, explicit in zip(jax.tree.leaves(law_4_1()), jax.tree.leaves(named), strict=True):
        np.testing.assert_array_equal(default, explicit)


KP, KI, KD = 200.0, 300.0, 50.0


def pid_command(law, q, dq, z):
    reference = Reference(q=[0.0, 0.0])
    return law(jnp.zeros(()), State(q=q, dq=dq), reference, reference, jnp.asarray(z))


def test_joint_pid_agrees_with_its_equations():
    q, dq, z = jnp.array([0.1, -0.2]), jnp.array([0.3, 0.4]), jnp.array([-0.05, 0.02])
    answer = pid_command(pid_4_1(kp=KP, ki=KI, kd=KD), q, dq, z)
    np.testing.assert_allclose(answer.tau, -KP * q - KD * dq - KI * z, rtol=1e-14)
    np.testing.assert_array_equal(answer.rate, q)
    heavy = pid_command(pid_4_1(kp=KP, ki=KI, kd=KD, gravity=0.5), q, dq, z)
    np.testing.assert_allclose(heavy.tau - answer.tau, 0.5 * TWO_LINK_NOMINAL.gravity(q), rtol=1e-12)


def test_joint_integral_stops_beyond_the_torque_limit_unless_it_reduces_the_torque():
    law = pid_4_1(kp=KP, ki=KI, kd=KD, limit=[10.0, 100.0])
    e = jnp.array([0.1, 0.1])
    np.testing.assert_array_equal(pid_command(law, e, jnp.zeros(2), [0.0, 0.0]).rate, [0.0, 0.1])
    # With an integral of the other sign, the error unwinds it even at the limit.
    np.testing.assert_array_equal(pid_command(law, e, jnp.zeros(2), [-1.0, 0.0]).rate, [0.1, 0.1])


@pytest.mark.parametrize("sampled", [None, {}], ids=["as printed", "sampled-data"])
def test_anti_windup_more_than_halves_the_overshoot_after_a_long_saturation(sampled):
    """The arm starts 1 rad away; drives of 12 N m and an inertia of 8 kg m² keep it at the limit for about 1 s."""
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
    runs = [case.simulate(progress=False) for case in (scenario, winding)]
    past = [np.abs(run.log.e * (np.sign(run.log.e) != [1.0, -1.0])).max() for run in runs]
    assert past[0] < 0.5 * past[1] and runs[0].outcome.ok


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
def test_the_torque_agrees_with_the_papers_equations_at_random_states_in_the_envelope(law, gains, matrices, layer):
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
        answer = command(
            controller,
            jnp.asarray(t),
            jnp.asarray(e0),
            State(q=jnp.asarray(q), dq=jnp.asarray(dq)),
            Reference(q=jnp.asarray(qd), dq=jnp.asarray(dqd), ddq=jnp.asarray(ddqd)),
        )
        scale = np.abs(tau).max()
        # e = q - q_d loses digits where the envelope is narrow: 1e-16/rho relative.
        tolerance = 1e-11 + 1e-14 / rho.min()
        np.testing.assert_allclose(answer.signals["eps1"], eps1, rtol=1e3 * tolerance, atol=1e2 * tolerance)
        np.testing.assert_allclose(answer.signals["eps2"], eps2, rtol=0, atol=1e2 * tolerance * np.abs(eps2).max())
        np.testing.assert_allclose(answer.signals["s"], s, rtol=0, atol=1e2 * tolerance * np.abs(s).max())
        np.testing.assert_allclose(answer.signals["u"], u, rtol=1e2 * tolerance)
        np.testing.assert_allclose(answer.tau, tau, rtol=0, atol=1e2 * tolerance * scale)


def test_the_first_torque_of_example_4_1_agrees_with_the_papers_figure():
    reference = MOTION_4_1.reference(jnp.zeros(()))
    answer = command(law_4_1(), jnp.zeros(()), START_4_1.q - reference.q, START_4_1, reference)
    np.testing.assert_allclose(answer.tau, [103.653, -97.039], rtol=1e-5)


def test_a_full_reaching_gain_multiplies_as_a_matrix():
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


def test_the_law_takes_its_envelope_from_an_exponential_performance_function():
    controller = law_4_1(performance=Exponential([0.8, 0.6], 0.002, 1.0))
    memory = controller.init(jnp.zeros(()), State(q=jnp.ones(2), dq=jnp.ones(2)), Reference(*jnp.zeros((3, 2))))
    envelope = controller.envelope(jnp.asarray(1.0), memory)
    rho = np.array([0.798, 0.598]) * np.exp(-1.0) + 0.002
    np.testing.assert_allclose(envelope.upper, rho, rtol=1e-14)
    np.testing.assert_allclose(envelope.lower, -0.2 * rho, rtol=1e-14)


@eqx.filter_jit
def compiled(controller, memory, q, dq, reference):
    return controller(jnp.zeros(()), State(q=q, dq=dq), reference, reference, memory)


def random_states(n, seed=0, count=60):
    """States and references: far away, near, and with one joint exactly on the reference."""
    rng = np.random.default_rng(seed)
    for i in range(count):
        qd, dqd, ddqd = rng.normal(size=(3, n))
        e, de = rng.normal(size=(2, n)) * [1.0, 1e-2, 1e-4, 0.3][i % 4]
        if i % 4 == 3:
            e[rng.integers(n)] = 0.0
            de[rng.integers(n)] = 0.0
        yield qd + e, dqd + de, qd, dqd, ddqd


def command_of(controller, memory, q, dq, qd, dqd, ddqd):
    reference = Reference(q=jnp.asarray(qd), dq=jnp.asarray(dqd), ddq=jnp.asarray(ddqd))
    return compiled(controller, memory, jnp.asarray(q), jnp.asarray(dq), reference)


def agree(value, wanted, tau):
    np.testing.assert_allclose(value, wanted, rtol=0, atol=1e-10 * (1 + np.abs(tau).max()))


@pytest.mark.parametrize("layer", [0.0, 0.05])
@pytest.mark.parametrize(
    ("law", "transcription", "matrices", "n"),
    [
        pytest.param(ftsmc_4_1, printed.ftsmc, matrices_4_1, 2, id="ftsmc"),
        pytest.param(sfsmc_4_2, printed.sfsmc, matrices_4_2, 3, id="sfsmc"),
        pytest.param(nftsmc_4_2, printed.nftsmc, matrices_4_2, 3, id="nftsmc"),
    ],
)
def test_torques_of_terminal_schemes_agree_with_their_equations(law, transcription, matrices, n, layer):
    controller = law(layer=layer)
    for state in random_states(n):
        tau, s, u = transcription(*state, matrices, layer)
        answer = command_of(controller, (), *state)
        agree(answer.signals["s"], s, 0.0)
        agree(answer.signals["u"], u, tau)
        agree(answer.tau, tau, tau)


def test_ftsmppc_differs_from_the_printed_law_only_by_its_linear_core():
    """Outside the core both powers agree; inside, a straight line replaces the cubic of the transcription."""
    rng = np.random.default_rng(0)
    zero, outside = jnp.zeros(()), 0
    for i in range(60):
        qd, dqd, ddqd, dq = rng.normal(size=(4, 2))
        e0 = np.array([-0.6, 0.5])
        e = rng.uniform([-0.7, -0.1], [0.1, 0.5]) if i % 2 else rng.normal(size=2) * 1e-3
        tau, s, eps1, _, _ = torque(TABLE_1._replace(s0=0.05), 0.0, e0, qd + e, dq, qd, dqd, ddqd, matrices_4_1)
        origin = Reference(*jnp.zeros((3, 2)))
        controller = ftsmppc_4_1()
        memory = controller.init(zero, State(q=jnp.asarray(e0), dq=jnp.zeros(2)), origin)
        answer = command_of(controller, memory, qd + e, dq, qd, dqd, ddqd)
        if np.all(np.abs(eps1) > 0.01):
            outside += 1
            agree(answer.signals["s"], s, 0.0)
            agree(answer.tau, tau, tau)
            continue
        near, _ = printed.hat_power(eps1, 0.5, 0.01)
        l1, l2, l3 = 1.875 * 0.01**-0.5, -1.25 * 0.01**-1.5, 0.375 * 0.01**-2.5
        cubic = [v if abs(x) >= 0.01 else l1 * x + l2 * abs(x) * x + l3 * x**3 for x, v in zip(eps1, near, strict=True)]
        np.testing.assert_allclose(answer.signals["s"], s + 0.2 * (near - np.array(cubic)), rtol=1e-9, atol=1e-11)
    assert 10 < outside < 50


def test_anftsmc_and_its_rate_agree_with_their_equations():
    controller, b = anftsmc_4_2(), np.array([0.3, 0.2, 0.1])
    for state in random_states(3):
        tau, s, size, rate = printed.anftsmc(*state, matrices_4_2, b)
        answer = command_of(controller, jnp.asarray(b), *state)
        agree(answer.signals["s"], s, 0.0)
        agree(answer.signals["u"], size, 0.0)
        agree(answer.tau, tau, tau)
        agree(answer.rate, rate, rate)
        np.testing.assert_array_equal(answer.memory, b)


@pytest.mark.parametrize("layer", [0.0, 0.05])
def test_slotine_li_agrees_with_its_equations(layer):
    controller = slotine_li_4_1(layer=layer)
    for state in random_states(2):
        tau, s = printed.slotine_li(*state, matrices_4_1, layer)
        answer = command_of(controller, (), *state)
        agree(answer.signals["s"], s, 0.0)
        agree(answer.tau, tau, tau)


def test_super_twisting_and_its_rate_agree_with_their_equations():
    controller, v = super_twisting_4_2(), np.array([1.0, -2.0, 0.5])
    start = controller.init(jnp.zeros(()), START_4_2, MOTION_4_2.reference(jnp.zeros(())))
    np.testing.assert_array_equal(start.v, 0.0)
    for state in random_states(3):
        tau, s, rate = printed.super_twisting(*state, matrices_4_2, v)
        answer = command_of(controller, eqx.tree_at(lambda m: m.v, start, jnp.asarray(v)), *state)
        agree(answer.signals["s"], s, 0.0)
        agree(answer.tau, tau, tau)
        moving = np.abs(s) > 1e-12
        np.testing.assert_array_equal(answer.rate.v[moving], rate[moving])


def test_computed_torque_and_gravity_pd_agree_with_their_equations():
    for q, dq, qd, dqd, ddqd in random_states(2):
        M0, C0, G0 = matrices_4_1(q, dq)
        e, de = q - qd, dq - dqd
        tau = M0 @ (ddqd - [90.0, 100.0] * e - 20.0 * de) + C0 @ dq + G0
        agree(command_of(computed_torque_4_1(kp=[90.0, 100.0]), (), q, dq, qd, dqd, ddqd).tau, tau, tau)
        tau = G0 - 400.0 * e - [90.0, 100.0] * de
        agree(command_of(gravity_pd_4_1(kd=[90.0, 100.0]), (), q, dq, qd, dqd, ddqd).tau, tau, tau)


ENVELOPED = [
    pytest.param(slotine_li_4_1(AROUND_4_1, Linear(0.6)), MOTION_4_1, START_4_1, id="slotine_li"),
    pytest.param(super_twisting_4_2(AROUND_4_2, Linear(0.6)), MOTION_4_2, START_4_2, id="super_twisting"),
]


@pytest.mark.parametrize(("controller", "trajectory", "start"), ENVELOPED)
def test_equivalent_control_in_an_envelope_holds_the_sliding_surface(controller, trajectory, start):
    """On the surface, where the robust parts are zero, the law makes `ṡ = 0` on the exact arm; ṡ along the motion."""
    memory = controller.init(jnp.zeros(()), start, trajectory.reference(jnp.zeros(())))
    arm = controller.nominal

    def ask(t, state):
        reference = trajectory.reference(t)
        return controller(t, state, reference, reference, memory)

    def s_of(t, state):
        return ask(t, state).signals["s"]

    def ds(t, q, dq):
        # s is ė plus a function of the position, so this velocity puts the state on the surface.
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
        # The remainder is the robust term for a rounding error in s, 12 √1e-15 for super-twisting.
        np.testing.assert_allclose(change, 0.0, atol=1e-6)
