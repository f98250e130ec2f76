"""Limits, dead time and lag against their definitions."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from slidax.core.errors import DefinitionError
from slidax.plant import Actuator, TorqueLimits

INF = float("inf")
PERIOD = jnp.asarray(1e-2)
COMMANDS = np.random.default_rng(1).normal(size=(8, 2))


def memories(actuator, commands, period=PERIOD):
    """The memory after each command."""
    memory, after = actuator.init(jnp.zeros(commands.shape[1])), []
    for tau in commands:
        _, memory = actuator.set(jnp.asarray(tau), period, memory)
        after.append(memory)
    return after


@pytest.mark.parametrize(
    ("limits", "command", "last", "expected"),
    [
        ((), [1e300, -5.0], [0.0, 0.0], [1e300, -5.0]),
        (([10.0, INF],), [-12.0, 12.0], [0.0, 0.0], [-10.0, 12.0]),
        ((INF, [100.0, 1000.0]), [12.0, 12.0], [5.0, 5.0], [6.0, 12.0]),
        ((10.0, 300.0), [40.0, -40.0], [9.0, 9.0], [10.0, 6.0]),
        # A torque limit below the last torque is kept at once, whatever the rate limit.
        ((5.0, 100.0), [20.0, -20.0], [12.0, -12.0], [5.0, -5.0]),
    ],
)
def test_limited_torque_is_the_nearest_one_within_both_limits(limits, command, last, expected):
    limited = TorqueLimits(*limits)(jnp.array(command), jnp.array(last), PERIOD)
    np.testing.assert_allclose(limited, expected, rtol=1e-15)


NUMBERS = st.floats(allow_nan=False, width=64)
LIMIT = st.floats(min_value=0.0, exclude_min=True, allow_nan=False)


@given(LIMIT, LIMIT, NUMBERS, st.floats(-1e100, 1e100))
def test_the_torque_limit_always_holds(torque, rate, wanted, last):
    """For any previous torque; if that was within the limit, the rate limit holds as well."""
    limits = TorqueLimits(torque, rate)
    limited = limits(jnp.array([wanted]), jnp.array([last]), PERIOD)[0]
    assert abs(limited) <= torque
    if abs(last) <= torque:
        assert abs(limited - last) <= rate * PERIOD * (1 + 1e-12) + 1e-12 * abs(last)
        if abs(wanted) <= torque and abs(wanted - last) <= rate * PERIOD * (1 - 1e-12) - 1e-12 * abs(last):
            assert limited == wanted


def test_the_torque_limit_also_applies_to_the_initial_torque():
    actuator = Actuator(TorqueLimits([5.0, 2.0], 100.0), time_constant=0.01, dead_time=1.5)
    memory = actuator.init(jnp.array([12.0, -9.0]))
    for _ in range(4):
        tau, memory = actuator.set(jnp.array([20.0, -1.5]), PERIOD, memory)
        delivered = [actuator.delivered(memory, share * PERIOD, PERIOD) for share in (0.0, 0.4, 1.0)]
        assert np.all(np.abs([tau, *delivered]) <= [5.0, 2.0])
    np.testing.assert_allclose(tau, [5.0, -1.5])


def test_the_rate_limit_counts_from_the_limited_and_not_the_requested_torque():
    actuator = Actuator(TorqueLimits(INF, 100.0))
    memory = actuator.init(jnp.zeros(1))
    torques = []
    for tau in (5.0, 5.0, -5.0, -0.5):
        tau_set, memory = actuator.set(jnp.array([tau]), PERIOD, memory)
        torques.append(float(tau_set[0]))
    np.testing.assert_allclose(torques, [1.0, 2.0, 1.0, 0.0], atol=1e-14)


def test_the_initial_torque_holds_until_the_first_command_acts():
    """Constant through the dead time, then decaying with the lag; the rate limit counts from it as well."""
    held = jnp.array([8.0, -3.0])
    actuator = Actuator(TorqueLimits(INF, 50.0), time_constant=[0.02, 0.0], dead_time=1.25)
    memory, felt = actuator.init(held), []
    for _ in range(3):
        tau, memory = actuator.set(jnp.zeros(2), PERIOD, memory)
        felt.append([actuator.delivered(memory, share * PERIOD, PERIOD) for share in (0.1, 0.75)])
        if len(felt) == 1:
            np.testing.assert_allclose(tau, [7.5, -2.5], rtol=1e-14)
    np.testing.assert_array_equal(felt[0], [held, held])
    np.testing.assert_allclose(felt[1][0], held, rtol=1e-14)
    # Half a period after the command of 7.5, -2.5 began to act.
    np.testing.assert_allclose(felt[1][1], [7.5 + 0.5 * np.exp(-0.25), -2.5], rtol=1e-14)


def test_an_ideal_drive_delivers_each_command_through_its_whole_period():
    actuator = Actuator()
    for memory, tau in zip(memories(actuator, COMMANDS), COMMANDS, strict=True):
        for share in (0.0, 0.5, 1.0):
            np.testing.assert_array_equal(actuator.delivered(memory, share * PERIOD, PERIOD), tau)


@pytest.mark.parametrize("dead_time", [1, 3, 0.25, 1.75, 2.5])
def test_a_dead_time_delays_the_commands_exactly(dead_time):
    actuator = Actuator(dead_time=dead_time)
    for k, memory in enumerate(memories(actuator, COMMANDS)):
        for share in (0.0, 0.1, 0.249, 0.251, 0.49, 0.51, 0.74, 0.76, 0.999):
            age = int(np.floor(k + share - dead_time))
            expected = COMMANDS[age] if age >= 0 else np.zeros(2)
            np.testing.assert_array_equal(actuator.delivered(memory, share * PERIOD, PERIOD), expected)


def test_a_delayed_command_acts_from_its_exact_instant_on():
    actuator = Actuator(dead_time=1.5)
    memory = memories(actuator, COMMANDS)[4]
    np.testing.assert_array_equal(actuator.delivered(memory, 0.5 * PERIOD, PERIOD), COMMANDS[3])
    np.testing.assert_array_equal(
        actuator.delivered(memory, np.nextafter(0.005, 0) * jnp.ones(()), PERIOD), COMMANDS[2]
    )


@pytest.mark.parametrize("dead_time", [0, 1, 0.3, 2.6])
def test_delivered_torque_agrees_with_a_fine_integration(dead_time):
    """Classical Runge-Kutta on 1000 steps a period, each within one command."""
    actuator, constant = Actuator(time_constant=[3e-3, 2e-2], dead_time=dead_time), np.array([3e-3, 2e-2])
    steps, h, torque = 1000, 1e-5, np.zeros(2)
    for k, memory in enumerate(memories(actuator, COMMANDS)):
        for i in range(steps):
            age = int(np.floor(k + (i + 0.5) / steps - dead_time))
            command = COMMANDS[age] if age >= 0 else np.zeros(2)
            k1 = (command - torque) / constant
            k2 = (command - torque - 0.5 * h * k1) / constant
            k3 = (command - torque - 0.5 * h * k2) / constant
            k4 = (command - torque - h * k3) / constant
            torque = torque + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
            if i % 100 == 99:
                delivered = actuator.delivered(memory, jnp.asarray((i + 1) / steps) * PERIOD, PERIOD)
                np.testing.assert_allclose(delivered, torque, atol=1e-12)


def test_the_lag_advances_by_the_length_of_the_last_period():
    """Periods may differ in length: the last period passed to `set` counts."""
    actuator = Actuator(time_constant=0.02)
    _, memory = actuator.set(jnp.array([1.0]), jnp.asarray(1e-2), actuator.init(jnp.zeros(1)))
    _, memory = actuator.set(jnp.array([1.0]), jnp.asarray(3e-2), memory)
    np.testing.assert_allclose(memory.lagged, [1 - np.exp(-1.5)], rtol=1e-14)


def test_the_gradient_by_the_time_constant_is_that_of_the_exponential():
    def torque(constant):
        actuator = Actuator(time_constant=constant)
        _, memory = actuator.set(jnp.array([1.0]), PERIOD, actuator.init(jnp.zeros(1)))
        return actuator.delivered(memory, PERIOD, PERIOD)[0]

    expected = -np.exp(-0.5) * 1e-2 / 0.02**2
    np.testing.assert_allclose(jax.grad(torque)(jnp.asarray(0.02)), expected, rtol=1e-12)


@pytest.mark.parametrize(
    ("make", "field", "value", "rule"),
    [
        (TorqueLimits, "torque", [INF, float("nan")], "got nan for joint 2"),
        (Actuator, "time_constant", INF, "must be >= 0 s"),
        (Actuator, "dead_time", -0.5, r"must be in \[0, 100\]; got -0.5"),
        (Actuator, "dead_time", float("nan"), r"must be in \[0, 100\]"),
        (lambda **rate: TorqueLimits([1.0, 2.0], **rate), "rate", [1.0, 2.0, 3.0], "has 3 entries"),
    ],
)
def test_invalid_actuator_parameters_are_refused(make, field, value, rule):
    with pytest.raises(DefinitionError, match=rf"`(Actuator|TorqueLimits)\.{field}` .*{rule}"):
        make(**{field: value})
