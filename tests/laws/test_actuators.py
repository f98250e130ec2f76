"""Every actuator is a pure function of arrays, causal, limited, and finite for any command."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from slidax.plant import Actuator, TorqueLimits
from tests.enrolled import assert_finite, assert_same, assert_same_form, every

PERIOD = jnp.asarray(1e-2)
COMMANDS = jnp.asarray(np.random.default_rng(0).normal(size=(20, 2)) * [30.0, 3.0])

ACTUATORS: list[tuple[str, Actuator]] = [
    ("ideal", Actuator()),
    ("limited", Actuator(TorqueLimits([20.0, 2.0], 500.0))),
    ("lag", Actuator(time_constant=[5e-3, 0.0])),
    ("one_period", Actuator(dead_time=1)),
    ("between_samples", Actuator(dead_time=0.3)),
    ("long", Actuator(dead_time=4.75)),
    ("all_at_once", Actuator(TorqueLimits([20.0, 2.0], [500.0, 100.0]), [5e-3, 2e-2], 1.6)),
]
# The others are parts of the last one, or the same with another dead time.
EVERY = every("actuator", ACTUATORS, full=("limited", "lag", "one_period", "between_samples"))


def uncompiled(actuator, commands=COMMANDS, period=PERIOD):
    """Torques set at each sample, and delivered at its start, in its middle and at its end."""

    def sample(memory, tau):
        tau_set, memory = actuator.set(tau, period, memory)
        return memory, (tau_set, [actuator.delivered(memory, share * period, period) for share in (0.0, 0.5, 1.0)])

    return jax.lax.scan(sample, actuator.init(jnp.zeros(2)), commands)[1]


# One program serves all tests of a member.
delivered = eqx.filter_jit(uncompiled)


@EVERY
def test_compiled_and_eager_torques_agree(actuator):
    with jax.disable_jit():
        eager = uncompiled(actuator)
    assert_same(delivered(actuator), eager, rtol=1e-12)


@EVERY
def test_a_batch_over_parameters_and_commands_equals_a_loop(actuator):
    inputs = [jax.tree.map(lambda x, f=factor: x * f, (actuator, COMMANDS)) for factor in (0.5, 1.0, 2.0)]
    looped = [delivered(*each) for each in inputs]
    many, looped = (jax.tree.map(lambda *parts: jnp.stack(parts), *each) for each in (inputs, looped))
    assert_same(eqx.filter_jit(jax.vmap(uncompiled))(*many), looped, rtol=1e-12)


@EVERY
def test_the_same_call_gives_bitwise_equal_torques(actuator):
    assert_same(delivered(actuator), delivered(actuator))


@EVERY
def test_memory_keeps_its_tree_structure_shapes_and_types(actuator):
    memory = actuator.init(jnp.zeros(2))
    after = actuator.set(COMMANDS[0], PERIOD, memory)[1]
    assert_same_form(after, memory)


@EVERY
def test_set_torque_keeps_the_torque_and_rate_limits(actuator):
    tau = np.asarray(delivered(actuator)[0])
    changes = np.abs(np.diff(np.concatenate([np.zeros((1, 2)), tau]), axis=0))
    assert np.all(np.abs(tau) <= actuator.limits.torque)
    assert np.all(changes <= np.asarray(actuator.limits.rate) * 1e-2 * (1 + 1e-12))


@EVERY
def test_delivered_torque_lies_between_set_commands(actuator):
    tau, moments = delivered(actuator)
    highest = np.maximum.accumulate(np.maximum(np.asarray(tau), 0.0))
    lowest = np.minimum.accumulate(np.minimum(np.asarray(tau), 0.0))
    for moment in moments:
        assert np.all(moment <= highest * (1 + 1e-12)) and np.all(moment >= lowest * (1 + 1e-12))


@EVERY
def test_torque_is_continuous_between_periods_exactly_with_a_lag_or_a_fractional_dead_time(actuator):
    _, (start, _, end) = delivered(actuator)
    continuous = (np.asarray(actuator.time_constant) > 0) | (actuator.change > 0)
    gap = np.abs(np.asarray(end)[:-1] - np.asarray(start)[1:])
    np.testing.assert_array_equal(gap.max(axis=0) < 1e-12, np.broadcast_to(continuous, 2))


@EVERY
def test_a_constant_command_is_delivered_eventually(actuator):
    _, moments = delivered(actuator, jnp.tile(jnp.array([7.0, -1.5]), (200, 1)))
    for moment in moments:
        np.testing.assert_allclose(moment[-1], [7.0, -1.5], rtol=1e-12)


@EVERY
def test_delivered_torque_does_not_depend_on_later_commands(actuator):
    other = COMMANDS.at[10:].set(0.0)
    for a, b in zip(jax.tree.leaves(delivered(actuator)), jax.tree.leaves(delivered(actuator, other)), strict=True):
        np.testing.assert_array_equal(a[:10], b[:10])


@pytest.mark.parametrize("size", [0.0, 5e-324, 1e-160, 1e150, 1e307])
@EVERY
def test_torque_is_finite_for_any_command(actuator, size):
    commands = size * jnp.tile(jnp.array([[1.0, -1.0], [-1.0, 1.0]]), (10, 1))
    assert_finite(delivered(actuator, commands))


@EVERY
def test_gradients_by_parameters_commands_and_period_are_finite(actuator):
    @eqx.filter_jit
    @eqx.filter_grad
    def gradients(inputs):
        return sum(jnp.sum(leaf) for leaf in jax.tree.leaves(uncompiled(*inputs)))

    assert_finite(gradients((actuator, COMMANDS, PERIOD)))
