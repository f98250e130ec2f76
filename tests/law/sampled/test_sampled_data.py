"""The sampled-data law: its exact motion without a disturbance, its limit, its memory, its recovery, its steps."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from slidax import analysis
from slidax.core.types import Reference, State
from slidax.export.guarded_step import GuardedStep
from slidax.law import (
    AbstractEstimator,
    Estimate,
    FixedTime,
    Measured,
    Recovery,
    StepInput,
    UncertaintyBound,
    cftsmppc,
    sampled_data,
)
from slidax.law.implicit_steps import Barrier, Plan
from slidax.motions import ConstantPosture as Still
from slidax.plant import Actuator, Constant, Delayed, Exact, TorqueLimits
from slidax.scenarios import load
from slidax.simulation import Plant, simulate, simulate_batch
from tests.paper_examples import MOTION_4_1, MOTION_4_2, SCARA, START_4_1, START_4_2, TWO_LINK_NOMINAL, law_4_1
from tests.rivals import anftsmc_4_2, computed_torque_4_1, super_twisting_4_2
from tests.simulation.simple import FreeMass

compiled = eqx.filter_jit(lambda law, *arguments: law(*arguments))
"""Calls a law; compiled once for all tests that call it directly."""

BOUND = UncertaintyBound(0.9, 1.1, 12.0, 2.2, 2.8, 1.0)


def mass_law(k1=0.4, k2=0.8, final=2e-3):
    """The printed law on a free unit mass, whose nominal motion a step predicts exactly."""
    performance = FixedTime(0.5, final, 1.0, 2.01)
    return cftsmppc(FreeMass(), performance=performance, overshoot=0.2, bound=BOUND, layer=0.0, k1=k1, k2=k2)


MEANS = ((1e-3, 1.0), (0.03, 4.0))
KEPT = (((0.41, 0.0), 1.0, 1e-3), ((-0.41, 0.2), 3.0, 1e-2), ((0.3, -2.0), 1.0, 0.03))
"""Cases of the daily run: each period, horizon and start at least once."""


def mass_run(period, horizon, e0=0.3, de0=0.0, push=0.0, gain=0.0, t1=1.5, **gains):
    law = sampled_data(mass_law(**gains), period=period, horizon=horizon, estimator=Measured(gain))
    plant = Plant(FreeMass(), Constant([push]))
    start = State(q=jnp.array([e0]), dq=jnp.array([de0]))
    end = round(t1 / period) * period
    return law, simulate(plant, law, Still([0.0]), start, t1=end, period=period, outside="recover")


@pytest.mark.parametrize(
    ("period", "horizons"),
    [
        pytest.param(period, horizons, marks=[] if (period, horizons) in MEANS else [pytest.mark.full])
        for period in (1e-3, 1e-2, 0.03)
        for horizons in (1.0, 1.5, 4.0)
    ],
)
def test_undisturbed_error_and_led_error_follow_the_documented_recursions(period, horizons):
    """`y⁺ = (1 - r) y + r ρ_a ψ(ε)` and `(1 + η) e⁺ = (1 - η) e + η (y + y⁺)`, to rounding, at any period."""
    law, run = mass_run(period, horizons * period)
    log = run.log
    lead, r = (horizons - 0.5) * period, 1.0 / horizons
    y = log.e + lead * log.de
    sides = law.step.transformation.init(jnp.zeros(()), jnp.asarray(log.e[0]))

    def end(t, eps):
        frame = law.step.transformation.frame(t, jnp.asarray(lead), law.horizon, sides)
        return frame.ahead * frame.psi_and_slope(eps)[0]

    target = np.asarray(jax.vmap(end)(jnp.asarray(log.t), jnp.asarray(log.signals["eps1"])))
    np.testing.assert_allclose(y[1:], (1 - r) * y[:-1] + r * target[:-1], atol=1e-13)
    eta = 0.5 * period / lead
    np.testing.assert_allclose((1 + eta) * log.e[1:], (1 - eta) * log.e[:-1] + eta * (y[:-1] + y[1:]), atol=1e-13)


STARTS = ((0.41, 0.0), (-0.41, 0.2), (0.3, -2.0))


@pytest.mark.parametrize(
    ("start", "horizons", "period"),
    [
        pytest.param(start, horizons, period, marks=[] if (start, horizons, period) in KEPT else [pytest.mark.full])
        for start in STARTS
        for horizons in (1.0, 3.0)
        for period in (1e-4, 1e-3, 1e-2, 0.03)
    ],
)
def test_undisturbed_error_stays_in_the_envelope_at_periods_up_to_30_ms(period, horizons, start):
    """Requires a positive led envelope `ρ + c ρ̇`, and a led error that starts inside it."""
    law, run = mass_run(period, horizons * period, *start, k1=3.0, k2=5.0, final=0.02)
    lead = law.horizon - 0.5 * period
    led = jax.vmap(lambda t: law.step.transformation.frame(t, lead, law.horizon, run_sides(law, run)).now)(run.log.t)
    assert np.all(start[0] + lead * start[1] < led[0]) and np.all(np.asarray(led) > 0.01)
    assert run.outcome.ok, run.outcome.message


@pytest.mark.parametrize("horizons", [1.0, 3.0])
def test_error_under_a_constant_disturbance_settles_at_the_theoretical_value(horizons):
    """`e = H² w + ρ∞ ψ(ε)` with `φ(ε) = H w`."""
    period, push = 5e-3, 2.0
    law, run = mass_run(period, horizons * period, push=push, final=0.05, t1=4.0)
    horizon = float(law.horizon)
    eps = run.log.signals["eps1"][-1]
    np.testing.assert_allclose(law.step.surface.phi_and_slope(jnp.asarray(eps))[0], horizon * push, rtol=1e-6)
    frame = law.step.transformation.frame(jnp.asarray(4.0), jnp.zeros(()), law.horizon, run_sides(law, run))
    expected = horizon**2 * push + frame.now * frame.psi_and_slope(jnp.asarray(eps))[0]
    np.testing.assert_allclose(run.log.e[-1], expected, rtol=1e-6)


def run_sides(law, run):
    return law.step.transformation.init(jnp.zeros(()), jnp.asarray(run.log.e[0]))


def test_the_disturbance_estimate_cancels_a_constant_disturbance():
    _, run = mass_run(5e-3, 1e-2, push=2.0, gain=0.5, final=0.05, t1=4.0)
    assert abs(run.log.e[-1, 0]) < 1e-12
    np.testing.assert_allclose(run.log.signals["disturbance"][-1], 2.0, rtol=1e-9)


def test_sampled_data_law_converges_to_the_printed_law_at_first_order_in_the_period():
    scenario = load("example-4.1", {"simulation.t1": 1.0, "simulation.period": 2e-5})
    printed = scenario.simulate(log_every=40)
    law = law_4_1()
    differences = []
    for period in (4e-4, 2e-4, 1e-4):
        implicit = sampled_data(law, period=period, horizon=period, estimator=Measured(0.0))
        run = simulate(
            scenario.plant, implicit, scenario.trajectory, START_4_1, t1=1.0, period=period, substeps=2,
            log_every=round(8e-4 / period),
        )  # fmt: skip
        differences.append(np.abs(run.log.e - printed.log.e).max())
    orders = np.log2(np.array(differences[:-1]) / differences[1:])
    assert np.all((orders > 0.8) & (orders < 1.3)), (differences, orders)
    assert differences[-1] < 2e-4


@pytest.mark.parametrize(
    ("period", "steady", "travel"),
    [(1e-4, (4.5e-9, 9.6e-9), 2110.8), (1e-3, (4.4e-7, 8.9e-7), 2530.0), (2e-3, (2.2e-6, 3.9e-6), 2960.0)],
)
def test_steady_error_without_delay_and_limits_is_within_the_documented_bound(period, steady, travel):
    scenario = load("example-4.1")
    law = sampled_data(law_4_1(layer=0.0), period=period, horizon=period, estimator=Measured(0.0), slopes=False)
    run = simulate(
        scenario.plant, law, scenario.trajectory, START_4_1, t1=10.0, period=period,
        substeps=max(1, round(period / 2e-4)), log_every=None,
    )  # fmt: skip
    assert analysis.envelope_violations(run) == 0 and np.all(analysis.steady_error(run) <= steady)
    settled = analysis.settling_time(run, 1e-3)
    assert settled[0] < 1.03 and settled[1] < 0.92 and np.all(analysis.peak_torque(run) < 98.0)
    assert np.all(analysis.torque_travel(run) <= travel)


@pytest.mark.parametrize("period", [1e-2, 1.1e-2])
def test_no_error_leaves_the_envelope_at_100_hz_with_or_without_a_disturbance_estimate(period):
    scenario = load("example-4.1")
    for gain in (0.0, 0.5):
        law = sampled_data(law_4_1(layer=0.0), period=period, horizon=period, estimator=Measured(gain))
        run = simulate(
            scenario.plant, law, scenario.trajectory, START_4_1, t1=round(10 / period) * period, period=period,
            substeps=50, log_every=None,
        )  # fmt: skip
        assert run.outcome.ok, run.outcome.message
        assert np.all(analysis.steady_error(run) < (4.4e-4 if gain == 0 else 3e-6))


@pytest.mark.full
def test_prediction_compensates_a_known_delay():
    """With the true model and no disturbance, the run with a period of delay follows the one without."""
    law = mass_law()
    runs = []
    for delay, dead_time in ((0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (2.5, 0.5)):
        implicit = sampled_data(law, period=2e-3, delay=delay, dead_time=dead_time)
        sensor = Delayed(Exact(), delay - dead_time) if delay > dead_time else None
        actuator = Actuator(dead_time=dead_time) if dead_time else None
        plant = Plant(FreeMass(), Constant([0.0]), sensor, actuator)
        start = State(q=jnp.array([0.3]), dq=jnp.array([0.0]))
        runs.append(simulate(plant, implicit, Still([0.0]), start, t1=1.2, period=2e-3, substeps=2))
    for run in runs[1:]:
        assert run.outcome.ok and np.abs(run.log.e - runs[0].log.e).max() < 4e-3
        np.testing.assert_allclose(run.log.e[-1], 0.0, atol=1e-7)
    # The model predicts over a sensor delay without a loss of information.
    np.testing.assert_allclose(runs[1].log.e[50:], runs[0].log.e[50:], atol=2e-4)


def test_lost_samples_restart_the_plan_and_do_not_change_the_disturbance_estimate():
    law = sampled_data(mass_law(), period=1e-3)
    still = Reference(q=jnp.zeros(1), dq=jnp.zeros(1), ddq=jnp.zeros(1))
    state = State(q=jnp.array([0.1]), dq=jnp.array([0.0]))
    memory = law.init(jnp.asarray(0.0), state, still)
    for k in range(3):
        # Bitwise equal positions would be a frozen sensor.
        state = State(q=jnp.array([0.1 + 1e-9 * k]), dq=jnp.array([0.0]))
        memory = compiled(law, jnp.asarray(1e-3 * k), state, still, still, memory).memory
    moved = State(q=jnp.array([0.1 + 1e-8]), dq=jnp.array([0.5]))
    near, far = (compiled(law, jnp.asarray(t), moved, still, still, memory) for t in (3e-3, 23e-3))
    assert float(jnp.abs(near.memory.prior.disturbance - memory.prior.disturbance)[0]) > 1.0
    np.testing.assert_array_equal(far.memory.prior.disturbance, memory.prior.disturbance)
    np.testing.assert_array_equal(far.signals["residual"], 0.0)


@pytest.mark.full
def test_the_torque_limit_holds_at_the_first_sample_even_if_the_initial_torque_exceeds_it():
    """The guards in exported code then have nothing to limit."""
    limits = TorqueLimits(5.0, 4000.0)
    law = sampled_data(law_4_1(), period=1e-3, limits=limits)
    guard = GuardedStep.around(law, limits, 1e-3)
    motion = load("example-4.1").trajectory
    now, ahead = motion.reference(jnp.asarray(0.0)), motion.reference(jnp.asarray(1e-3))
    memory = law.init(jnp.asarray(0.0), START_4_1, now)
    assert np.any(np.abs(memory.torques[-1]) > 9.0)
    tau = law(jnp.asarray(0.0), START_4_1, now, ahead, memory).tau
    assert np.all(np.abs(tau) <= 5.0)
    kept = guard.init(jnp.asarray(0.0), START_4_1, now)
    np.testing.assert_array_equal(guard(jnp.asarray(0.0), START_4_1, now, ahead, kept).tau, tau)


@pytest.mark.parametrize("value", [0.0, 1e-300, 1.0, -30.0, 1e6, -1e12])
def test_every_finite_measurement_has_a_finite_torque_within_the_limits(value):
    limits = TorqueLimits(60.0, 4000.0)
    law = sampled_data(law_4_1(layer=0.0), period=1e-3, limits=limits, recovery=Recovery())
    motion = load("example-4.1").trajectory
    now, ahead = motion.reference(jnp.asarray(0.0)), motion.reference(jnp.asarray(1e-3))
    memory = law.init(jnp.asarray(0.0), START_4_1, now)
    memory = compiled(law, jnp.asarray(0.0), START_4_1, now, ahead, memory).memory
    for q, dq in ((value, 0.0), (0.3, value), (value, -value)):
        state = State(q=jnp.array([q, 0.2]), dq=jnp.array([0.1, dq]))
        command = compiled(law, jnp.asarray(1e-3), state, now, ahead, memory)
        assert np.all(np.isfinite(command.tau)) and np.all(np.abs(command.tau) <= 60.0)
        assert all(np.all(np.isfinite(leaf)) for leaf in jax.tree.leaves(command.memory))


@pytest.mark.parametrize("name", ["example-4.1-1khz", pytest.param("example-4.2-1khz", marks=pytest.mark.full)])
def test_all_200_starts_outside_the_envelope_are_back_inside_within_2_s(name):
    """Under torque and rate limits, a delay of one period, 20 % model error and the disturbance."""
    scenario = load(name)
    law, motion = scenario.controller, scenario.trajectory
    rng, n, cases = np.random.default_rng(0), law.joints, 200
    reference = motion.reference(jnp.zeros(()))
    radius = np.broadcast_to(law.step.transformation.performance.initial, (n,))
    e = rng.uniform(-1.5, 1.5, (cases, n)) * radius
    joint = rng.integers(n, size=cases)
    e[np.arange(cases), joint] = rng.choice([-1, 1], cases) * rng.uniform(1.05, 2.0, cases) * radius[joint]

    starts = State(q=reference.q + e, dq=reference.dq + rng.uniform(-1, 1, (cases, n)))
    many = simulate_batch(
        lambda start: (scenario.plant, law, motion, start), starts, t1=4.0, period=1e-3, substeps=4, outside="recover"
    )
    excursion, peak = many.excursion, many.tally.peak_torque
    assert np.all(np.asarray(many.fault.kind) == 0) and np.all(np.asarray(excursion.first) == 0)
    assert not np.any(excursion.outside) and np.asarray(excursion.last).max() * 1e-3 < 2.0
    assert np.all(np.asarray(peak) <= np.asarray(law.limits.torque))


H, STEP_PERIOD = 0.012, 1e-3


def test_the_super_twisting_step_solves_its_implicit_inclusion():
    """`s⁺ = s + H (v⁺ - k1 sig^½(s⁺))`, `v⁺ ∈ v - H k2 Sgn(s⁺)`."""
    law = super_twisting_4_2()
    step = sampled_data(law, period=STEP_PERIOD).step
    rng = np.random.default_rng(0)
    s = jnp.asarray(rng.normal(size=(500, 3)) * 10 ** rng.uniform(-4, 1, (500, 1)))
    v = jnp.asarray(rng.normal(size=(500, 3)) * 10 ** rng.uniform(-2, 1, (500, 1)))

    def reached(s, v):
        zero, unity = jnp.zeros(3), jnp.ones(())
        state, reference = State(zero, zero), Reference(zero, zero, zero)
        times = {
            "t": unity,
            "period": jnp.asarray(STEP_PERIOD),
            "horizon": jnp.asarray(H),
            "planned": jnp.ones((), bool),
            "settled": jnp.ones((), bool),
        }
        arm = {
            "mass": jnp.eye(3),
            "bias": zero,
            "limits": TorqueLimits(),
            "expected": zero,
            "robot": SCARA,
            "disturbance": zero,
        }
        moment = StepInput(state=state, reference=reference, **times, **arm)
        frame = law.transformation.frame(unity, unity, unity, ())
        plan = Plan.near(Barrier(frame, law.surface, times["horizon"]), zero, zero, s, zero)
        reached_step = step.reach(moment, plan, v)
        return reached_step.s_next, reached_step.memory

    after, memory = jax.vmap(reached)(s, v)
    v_end = v + (memory - v) * H / STEP_PERIOD
    root = np.sign(after) * np.sqrt(np.abs(after))
    np.testing.assert_allclose(after, s + H * (v_end - law.k1 * root), atol=1e-13, rtol=1e-12)
    turned = np.asarray(v - v_end) / (H * 70.0)
    moving = np.asarray(after) != 0
    np.testing.assert_allclose(turned[moving], np.sign(after)[moving], rtol=1e-9)
    assert np.all(np.abs(turned[~moving]) <= 1.0) and 200 < moving.sum() < 1300


class Believed(AbstractEstimator):
    """Returns the measured state and a constant disturbance."""

    disturbance: jax.Array

    def init(self, measured):
        return ()

    def __call__(self, measured, prior, elapsed, missed, memory):
        return Estimate(state=measured, disturbance=self.disturbance), ()


def first_torque(disturbance, limit):
    law = sampled_data(
        computed_torque_4_1(),
        period=STEP_PERIOD,
        limits=TorqueLimits(limit),
        estimator=Believed(jnp.asarray(disturbance)),
    )
    t = jnp.zeros(())
    now, ahead = MOTION_4_1.reference(t), MOTION_4_1.reference(t + STEP_PERIOD)
    state = State(q=now.q, dq=now.dq)
    return law(t, state, now, ahead, law.init(t, state, now)), TWO_LINK_NOMINAL.mass(now.q) @ jnp.asarray(disturbance)


def test_a_law_without_a_bound_compensates_a_disturbance_up_to_the_torque_limit():
    still, _ = first_torque([0.0, 0.0], 1e9)
    pushed, lumped = first_torque([0.5, -0.3], 1e9)
    np.testing.assert_allclose(still.tau - pushed.tau, lumped, rtol=1e-9)
    np.testing.assert_allclose(pushed.signals["disturbance"], [0.5, -0.3])
    astray, lumped = first_torque([500.0, -300.0], 60.0)
    share = 60.0 / float(jnp.abs(lumped).max())
    np.testing.assert_allclose(astray.signals["disturbance"], share * jnp.array([500.0, -300.0]), rtol=1e-12)
    np.testing.assert_array_equal(astray.memory.prior.disturbance, astray.signals["disturbance"])


@pytest.mark.parametrize("law", [super_twisting_4_2(), anftsmc_4_2(layer=0.01)], ids=["super_twisting", "anftsmc"])
def test_integral_state_stays_constant_while_the_torque_is_limited(law):
    t = jnp.zeros(())
    now, ahead = MOTION_4_2.reference(t), MOTION_4_2.reference(t + STEP_PERIOD)
    start = State(q=START_4_2.q + 0.3, dq=START_4_2.dq)

    def kept(limits):
        sampled = sampled_data(law, period=STEP_PERIOD, limits=limits)
        before = sampled.init(t, start, now)
        command = sampled(t, start, now, ahead, before)
        own = (lambda memory: memory.reaching) if hasattr(before.step, "reaching") else (lambda memory: memory)
        return np.asarray(own(before.step)), np.asarray(own(command.memory.step)), bool(command.memory.planned)

    before, free, planned = kept(TorqueLimits())
    assert planned and np.any(free != before)
    before, limited, planned = kept(TorqueLimits(20.0, 1000.0))
    assert not planned
    np.testing.assert_array_equal(limited, before)
