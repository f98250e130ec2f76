from functools import cache

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from slidax.core.types import Reference, State
from slidax.export import GuardedStep
from slidax.export.status import (
    CONDITIONS,
    ENVELOPE_LEFT,
    HELD,
    MEASUREMENT_NOT_FINITE,
    MEASUREMENT_OUT_OF_RANGE,
    MEASUREMENT_REJECTED,
    MISSED_PERIOD,
    RECOVERY_OVERDUE,
    REFERENCE_NOT_FINITE,
    STOP_REQUESTED,
    TORQUE_LIMITED,
    TORQUE_NOT_FINITE,
)
from slidax.plant import TorqueLimits
from slidax.scenarios import load
from slidax.simulation import simulate
from tests.paper_examples import MOTION_4_1, MOTION_4_2, START_4_1, law_4_1, plant_4_1
from tests.rivals import anftsmc_4_2, computed_torque_4_1

PERIOD = 1e-3
T = jnp.asarray(0.1)
NOW, NEXT = MOTION_4_1.reference(T), MOTION_4_1.reference(T + PERIOD)
STATE = State(q=NOW.q + jnp.array([0.3, -0.2]), dq=NOW.dq + jnp.array([0.1, 0.0]))


_step = eqx.filter_jit(lambda guard, *sample: guard.step(*sample))
_init = eqx.filter_jit(lambda guard, *sample: guard.init(*sample))


@cache
def unlimited():
    return GuardedStep.around(law_4_1(), TorqueLimits(), PERIOD)


@cache
def sampled():
    scenario = load("example-4.1-1khz")
    return GuardedStep.around(scenario.controller, scenario.plant.actuator.limits, scenario.period)


def guarded(torque=np.inf, rate=np.inf):
    limits = TorqueLimits(jnp.full(2, torque), jnp.full(2, rate))
    return eqx.tree_at(lambda g: g.limits, unlimited(), limits)


def begun(guard, t=T, state=STATE):
    return _init(guard, t, state, NOW)


def step(guard, memory, t=T, state=STATE, now=NOW, following=NEXT):
    command, status = _step(guard, t, state, now, following, memory)
    return command, int(status)


def after_one(guard):
    return step(guard, begun(guard))[0].memory, T + PERIOD


def test_status_bits_are_distinct_powers_of_two():
    assert [condition.bit for condition in CONDITIONS] == [2**k for k in range(len(CONDITIONS))]


def test_the_guarded_step_gives_the_laws_torque_for_a_valid_sample():
    guard = guarded()
    law = guard.controller
    memory = law.init(T, STATE, NOW)
    expected = law(T, STATE, NOW, NEXT, memory)
    command, status = step(guard, begun(guard))
    assert status == 0
    np.testing.assert_allclose(command.tau, expected.tau, rtol=1e-14)
    assert {"s", "eps1", "eps2", "u", "rho"} == set(command.signals)
    np.testing.assert_allclose(command.signals["s"], expected.signals["s"], rtol=1e-13)
    np.testing.assert_allclose(command.signals["rho"], law.transformation.performance.radius(T), rtol=1e-15)


def test_a_simulation_with_the_guarded_step_equals_a_simulation_with_the_law():
    alone, behind_guards = (
        simulate(plant_4_1(), law, MOTION_4_1, START_4_1, t1=0.2, period=PERIOD, substeps=5, engine="xla")
        for law in (law_4_1(), guarded())
    )
    np.testing.assert_allclose(behind_guards.log.tau, alone.log.tau, rtol=1e-9)
    assert not behind_guards.log.signals["status"].any()


def test_the_first_valid_sample_starts_the_law():
    guard = guarded()
    forgotten = jax.tree.map(jnp.zeros_like, begun(guard))
    by_itself, status = step(guard, forgotten)
    assert status == 0 and bool(by_itself.memory.started)
    np.testing.assert_array_equal(by_itself.tau, step(guard, begun(guard))[0].tau)


def test_an_invalid_first_sample_does_not_start_the_law_and_commands_zero_torque():
    guard = guarded()
    forgotten = jax.tree.map(jnp.zeros_like, begun(guard))
    command, status = step(guard, forgotten, state=eqx.tree_at(lambda s: s.q, STATE, STATE.q * jnp.nan))
    assert status == MEASUREMENT_NOT_FINITE.bit and not bool(command.memory.started)
    assert not command.tau.any()


@pytest.mark.parametrize("number", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("place", ["t", "q", "dq"])
def test_a_measurement_that_is_not_finite_holds_the_last_command_and_keeps_the_memory(place, number):
    guard = guarded()
    memory, t = after_one(guard)
    state = STATE
    if place == "t":
        t = jnp.asarray(number)
    else:
        state = eqx.tree_at(lambda s: getattr(s, place), STATE, getattr(STATE, place).at[1].set(number))
    command, status = step(guard, memory, t=t, state=state)
    assert status == MEASUREMENT_NOT_FINITE.bit
    np.testing.assert_array_equal(command.tau, memory.tau)
    assert eqx.tree_equal(command.memory, eqx.tree_at(lambda kept: kept.held, memory, jnp.ones(())))
    assert not any(np.any(signal) for signal in command.signals.values())


def test_a_position_out_of_range_holds_the_last_command():
    guard = eqx.tree_at(lambda g: g.gate.q_max, guarded(), jnp.array([10.0, 10.0]))
    memory, t = after_one(guard)
    far = eqx.tree_at(lambda s: s.q, STATE, jnp.array([0.0, -10.1]))
    command, status = step(guard, memory, t=t, state=far)
    assert status == MEASUREMENT_OUT_OF_RANGE.bit
    np.testing.assert_array_equal(command.tau, memory.tau)


def test_unused_inputs_may_be_nan_and_used_inputs_must_be_finite():
    guard = guarded()
    unknown = Reference(*[jnp.full(2, jnp.nan)] * 3)
    assert step(guard, begun(guard), following=unknown)[1] == 0
    assert step(guard, begun(guard), now=unknown)[1] == REFERENCE_NOT_FINITE.bit
    assert "next.q" not in guard.reads


def test_a_law_undefined_outside_its_envelope_reports_envelope_left_and_invalid_torque():
    # The gate would reject a jump of the arm, so the reference jumps here.
    guard = guarded()
    memory, t = after_one(guard)
    far = Reference(NOW.q - jnp.array([0.9, 0.0]), NOW.dq, NOW.ddq)
    command, status = step(guard, memory, t=t, now=far)
    assert status == ENVELOPE_LEFT.bit | TORQUE_NOT_FINITE.bit
    np.testing.assert_array_equal(command.tau, memory.tau)
    assert float(command.memory.t) == float(memory.t)


@pytest.mark.full
def test_a_law_defined_outside_its_envelope_continues_there():
    guard = sampled()
    outside = State(q=NOW.q + jnp.array([0.9, 0.0]), dq=NOW.dq)
    command, status = step(guard, begun(guard, state=outside), state=outside)
    assert status & ENVELOPE_LEFT.bit and not status & HELD and float(command.memory.t) == float(T)


@pytest.mark.full
def test_a_delayed_measurement_is_compared_with_the_reference_of_its_time():
    scenario = load("example-4.2-1khz")
    assert scenario.controller.delay == 1.0
    guard = GuardedStep.around(scenario.controller, scenario.plant.actuator.limits, scenario.period)
    t = jnp.asarray(20.0)
    past, now, following = (scenario.trajectory.reference(t + k * scenario.period) for k in (-1, 0, 1))
    late = State(q=past.q, dq=past.dq)
    radius = guard.controller.step.transformation.performance.radius(t)
    overshoot = guard.controller.step.transformation.overshoot
    assert jnp.any(jnp.abs(late.q - now.q) > overshoot * radius)
    _, status = guard.step(t, late, now, following, guard.init(t, late, now))
    assert not int(status) & ENVELOPE_LEFT.bit


def test_a_torque_beyond_its_limit_is_limited():
    free = step(guarded(), begun(guarded()))[0].tau
    limit = 0.5 * float(jnp.abs(free).max())
    command, status = step(guarded(torque=limit), begun(guarded(torque=limit)))
    assert status == TORQUE_LIMITED.bit
    np.testing.assert_allclose(command.tau, jnp.clip(free, -limit, limit))
    np.testing.assert_array_equal(command.memory.tau, command.tau)


def test_the_first_command_is_rate_limited_from_the_nominal_arms_gravity_torque():
    guard = guarded(rate=10.0)
    command, status = step(guard, begun(guard))
    assert status == TORQUE_LIMITED.bit
    weight = guard.controller.nominal.bias(STATE.q, STATE.dq)
    np.testing.assert_allclose(jnp.abs(command.tau - weight), 10.0 * PERIOD)


@pytest.mark.parametrize("make", [lambda: guarded(rate=10.0), sampled])
def test_the_first_command_after_invalid_samples_is_rate_limited_from_zero(make):
    guard = make()
    nothing = jax.tree.map(jnp.zeros_like, begun(guard))
    bad = eqx.tree_at(lambda s: s.q, STATE, STATE.q * jnp.nan)
    held, _ = step(guard, nothing, t=T - PERIOD, state=bad)
    assert not held.tau.any()
    first, status = step(guard, held.memory)
    assert not status & HELD
    rate = (guard.limits or guard.controller.limits).rate
    assert jnp.all(jnp.abs(first.tau) <= rate * PERIOD * (1 + 1e-12))


def test_the_torque_rate_is_limited_between_successive_commands():
    guard = guarded(rate=10.0)
    first, _ = step(guard, begun(guard))
    far = State(q=STATE.q, dq=STATE.dq + 1.0)
    second, status = step(guard, first.memory, t=T + PERIOD, state=far)
    assert status == TORQUE_LIMITED.bit
    np.testing.assert_allclose(jnp.abs(second.tau - first.tau), 10.0 * PERIOD)


def test_a_held_command_respects_a_torque_limit_lowered_in_the_meantime():
    guard = guarded()
    memory, t = after_one(guard)
    limit = 0.5 * float(jnp.abs(memory.tau).min())
    lower = guarded(torque=limit)
    command, status = step(lower, memory, t=t * jnp.nan)
    assert status == MEASUREMENT_NOT_FINITE.bit
    np.testing.assert_allclose(jnp.abs(command.tau), limit)


@pytest.mark.full
def test_parameters_that_are_nan_hold_the_last_command():
    guard = guarded()
    memory, t = after_one(guard)
    for where, value, condition in (
        (lambda g: g.controller.surface.k1, jnp.asarray(jnp.nan), TORQUE_NOT_FINITE),
        (lambda g: g.limits.torque, jnp.full(2, jnp.nan), TORQUE_NOT_FINITE),
        # Without a period no motion of the arm can be judged.
        (lambda g: g.period, jnp.asarray(jnp.nan), MEASUREMENT_REJECTED),
    ):
        absurd = eqx.tree_at(where, guard, value)
        absurd = eqx.tree_at(lambda g: g.limits.rate, absurd, jnp.full(2, 1e3))
        command, status = step(absurd, memory, t=t)
        assert status & condition.bit
        np.testing.assert_array_equal(command.tau, memory.tau)


@pytest.mark.parametrize(
    ("periods", "condition"),
    [
        *((1.0, 0), (1.4, 0), (1.6, MISSED_PERIOD.bit), (99.0, MISSED_PERIOD.bit), (101.0, MEASUREMENT_REJECTED.bit)),
        *((0.0, MEASUREMENT_REJECTED.bit), (-3.0, MEASUREMENT_REJECTED.bit)),
    ],
)
def test_a_missed_period_is_reported_and_an_implausible_time_stamp_is_rejected(periods, condition):
    guard = guarded()
    memory, _ = after_one(guard)
    command, status = step(guard, memory, t=T + periods * PERIOD)
    assert status == condition
    if condition & HELD:
        np.testing.assert_array_equal(command.tau, memory.tau)
        assert not any(np.any(signal) for signal in command.signals.values())


@pytest.mark.parametrize("make", [guarded, sampled])
def test_an_impossible_position_jump_is_rejected_and_the_next_valid_sample_is_accepted(make):
    guard = make()
    memory, t = after_one(guard)
    jump = State(q=STATE.q + jnp.array([2.0, 0.0]), dq=STATE.dq)
    held, status = step(guard, memory, t=t, state=jump)
    assert status == MEASUREMENT_REJECTED.bit
    np.testing.assert_array_equal(held.tau, memory.tau)
    assert float(held.memory.t) == float(memory.t)
    assert not any(np.any(signal) for name, signal in held.signals.items() if name != "rejected")
    _, status = step(guard, held.memory, t=t + PERIOD)
    assert not status & HELD


@pytest.mark.parametrize("fault", ["NaN", "far", "jumping", "clock stands still"])
@pytest.mark.parametrize("make", [guarded, sampled])
def test_a_stop_is_requested_after_five_held_commands_and_stays_requested(make, fault):
    guard = make()
    memory, t = after_one(guard)
    for count in range(1, 8):
        offset = {"NaN": np.nan, "far": 1e5, "jumping": (-1.0) ** count * 3.0, "clock stands still": 0.0}[fault]
        when = T if fault == "clock stands still" else t
        command, status = step(guard, memory, t=when, state=State(q=STATE.q + offset, dq=STATE.dq))
        assert status & HELD and bool(status & STOP_REQUESTED.bit) is (count >= 5)
        memory, t = command.memory, t + PERIOD
    _, status = step(guard, memory, t=t)
    assert not status & HELD and status & STOP_REQUESTED.bit


def test_recovery_is_overdue_once_a_joint_is_outside_for_longer_than_the_deadline():
    guard = sampled()
    guard = eqx.tree_at(
        lambda g: g.controller.step.transformation.performance.deadline, guard, jnp.full(2, 2.5 * PERIOD)
    )
    far = Reference(NOW.q - jnp.array([0.9, 0.0]), NOW.dq, NOW.ddq)
    memory, t, overdue = begun(guard), T, []
    for k in range(4):
        moved = State(q=STATE.q + k * PERIOD * STATE.dq, dq=STATE.dq)
        command, status = step(guard, memory, t=t, state=moved, now=far)
        assert status & ENVELOPE_LEFT.bit
        overdue.append(bool(status & RECOVERY_OVERDUE.bit))
        memory, t = command.memory, t + PERIOD
    assert overdue == [False, False, True, True]


def test_the_laws_memory_is_integrated_by_its_rate_over_a_period():
    law = anftsmc_4_2()
    guard = GuardedStep.around(law, TorqueLimits(), PERIOD)
    now = MOTION_4_2.reference(T)
    state = State(q=now.q + 0.1, dq=now.dq + 0.2)
    command, _ = guard.step(T, state, now, now, guard.init(T, state, now))
    rate = law(T, state, now, now, law.init(T, state, now)).rate
    assert rate.any()
    np.testing.assert_allclose(command.memory.law, law.initial + PERIOD * rate)


def test_a_law_without_an_envelope_never_reports_envelope_left():
    guard = GuardedStep.around(computed_torque_4_1(), TorqueLimits(), PERIOD)
    far = State(q=NOW.q + 100.0, dq=NOW.dq)
    assert step(guard, begun(guard, state=far), state=far)[1] == 0


def test_a_sampled_data_law_shares_its_limits_and_its_period_with_its_guards():
    guard = sampled()
    arrays = [
        jax.tree_util.keystr(path)
        for path, _ in jax.tree_util.tree_leaves_with_path(guard)
        if "limits" in jax.tree_util.keystr(path) or "period" in jax.tree_util.keystr(path)
    ]
    assert arrays == [".controller.limits.torque", ".controller.limits.rate", ".controller.period"]
    memory = begun(guard)
    assert step(guard, memory)[1] == TORQUE_LIMITED.bit
    loose = eqx.tree_at(lambda g: g.controller.limits, guard, TorqueLimits(jnp.full(2, 1e9), jnp.full(2, 1e9)))
    assert step(loose, memory)[1] == 0


def test_gravity_torque_at_the_first_command_is_not_reported_as_torque_limited():
    guard = sampled()
    still = Reference(q=NOW.q, dq=jnp.zeros(2), ddq=jnp.zeros(2))
    state = State(q=still.q, dq=still.dq)
    # Far less than the gravity torque in each period.
    slow = eqx.tree_at(lambda g: g.controller.limits.rate, guard, jnp.full(2, 100.0, float))
    command, status = step(slow, begun(slow, state=state), state=state, now=still, following=still)
    weight = slow.controller.nominal.gravity(state.q)
    assert np.abs(weight).max() > 1.0 and status == 0
    np.testing.assert_allclose(command.tau, weight, atol=0.1)
