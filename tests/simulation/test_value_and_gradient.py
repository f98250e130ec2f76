"""Values and gradients of metrics by both engines, against differences and `jax.grad`."""

import time

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from slidax import scenarios
from slidax.core.errors import DefinitionError
from slidax.simulation import simulate, value_and_gradient
from tests.paper_examples import MOTION_4_1, START_4_1, law_4_1, plant_4_1
from tests.simulation.simple import SMOOTH_PLANT, SPRING

HOW = {"t1": 0.1, "period": 1e-3}
AT = {"k": {"k1": jnp.array([0.2, 0.3]), "k2": 0.6}, "mass": 2.0}


def define(x):
    """Gains of the law, one of them per joint, and a mass of the arm."""
    law = eqx.tree_at(lambda c: (c.surface.k1, c.surface.k2), law_4_1(), (x["k"]["k1"], jnp.asarray(x["k"]["k2"])))
    plant = eqx.tree_at(lambda p: p.robot.masses, plant_4_1(), jnp.stack([jnp.asarray(x["mass"]), jnp.asarray(0.85)]))
    return plant, law, MOTION_4_1, START_4_1


def last_error(run):
    return jnp.sum((run.state.q - MOTION_4_1.position(run.t1)) ** 2) + jnp.sum(
        run.tally.early_error + run.tally.late_error
    )


def differences(metric, log_every, **how):
    h = 1e-6

    def value(shift):
        return float(metric(simulate(*define(rebuilt(numbers + shift)), log_every=log_every, engine="native", **how)))

    numbers, rebuilt = jax.flatten_util.ravel_pytree(jax.tree.map(jnp.asarray, AT))
    return rebuilt(jnp.array([(value(h * e) - value(-h * e)) / (2 * h) for e in jnp.eye(numbers.size)]))


def assert_close(ours, theirs, rtol):
    assert jax.tree.structure(ours) == jax.tree.structure(theirs)
    for mine, their in zip(jax.tree.leaves(ours), jax.tree.leaves(theirs), strict=True):
        assert np.shape(mine) == np.shape(their)
        np.testing.assert_allclose(mine, their, rtol=rtol, atol=1e-12)
        assert np.all(np.asarray(mine) != 0.0)


@pytest.mark.parametrize("mode", ["held", "continuous"])
def test_the_gradient_matches_finite_differences(mode):
    value, gradient = value_and_gradient(last_error, define, AT, mode=mode, **HOW, engine="native")
    run = simulate(*define(AT), mode=mode, log_every=None, **HOW, engine="native")
    assert float(value) == pytest.approx(float(last_error(run)), rel=1e-13)
    assert_close(gradient, differences(last_error, None, mode=mode, **HOW), 1e-5)


@pytest.mark.full
def test_both_engines_give_the_same_gradient():
    native = value_and_gradient(last_error, define, AT, **HOW, engine="native")
    xla = value_and_gradient(last_error, define, AT, **HOW, engine="xla")
    assert float(native[0]) == pytest.approx(float(xla[0]), rel=1e-12)
    assert_close(native[1], xla[1], 1e-8)


# `test_batches.py` uses reverse mode with a simpler law.
@pytest.mark.full
def test_reverse_mode_gives_the_same_gradient():
    native = value_and_gradient(last_error, define, AT, **HOW, engine="native")
    reverse = jax.jit(jax.grad(lambda x: last_error(simulate(*define(x), log_every=None, **HOW))))(AT)
    assert_close(native[1], reverse, 1e-8)


@pytest.mark.full
def test_the_gradient_of_a_metric_of_the_log_matches_finite_differences():
    def mean_square(run):
        return jnp.mean(run.log.e**2)

    _, gradient = value_and_gradient(mean_square, define, AT, **HOW, log_every=5, engine="native")
    assert_close(gradient, differences(mean_square, 5, **HOW), 1e-5)


def test_a_gradient_without_parameters_is_refused():
    with pytest.raises(DefinitionError, match="`at` must have the numbers with respect to which"):
        value_and_gradient(last_error, lambda _: define(AT), {}, **HOW)


@pytest.mark.full
def test_a_loop_without_native_code_is_differentiated_by_xla_with_a_warning():
    def sorted_start(x):
        return SMOOTH_PLANT, SPRING, MOTION_4_1, eqx.tree_at(lambda s: s.q, START_4_1, jnp.sort(START_4_1.q * x))

    with pytest.warns(UserWarning, match="engine `xla`, because there is no native code for the JAX primitive `sort`"):
        value, gradient = value_and_gradient(last_error, sorted_start, 1.0, t1=0.05, period=0.01)
    expected = value_and_gradient(last_error, sorted_start, 1.0, t1=0.05, period=0.01, engine="xla")
    np.testing.assert_array_equal((value, gradient), expected)


@pytest.mark.parametrize(
    ("name", "seconds"), [("example-4.2-1khz", 20.0), pytest.param("panda-payload", 60.0, marks=pytest.mark.full)]
)
def test_gradients_of_sampled_data_laws_compile_within_a_minute(name, seconds):
    """The limit is for the processor time of tracing, compilation and run; XLA's reverse mode takes many minutes.

    The encoders have no quantization here: its straight-through derivative differs from finite differences.
    """
    loop = scenarios.load(name, {} if name == "example-4.2-1khz" else {"sensor.resolution": 0.0})
    how = {"t1": 0.02, "stepping": loop.stepping, "engine": "native"}

    def with_gain(k1):
        law = eqx.tree_at(lambda c: c.step.surface.k1, loop.controller, k1)
        return loop.plant, law, loop.trajectory, loop.state0

    def steady(run):
        return jnp.sum(jnp.abs(run.state.q - loop.trajectory.position(run.t1)))

    k1, h = loop.controller.step.surface.k1, 1e-6
    started = time.process_time()
    _, gradient = value_and_gradient(steady, with_gain, k1, **how)
    assert time.process_time() - started < seconds
    up, down = (float(steady(simulate(*with_gain(k1 + d), log_every=None, **how))) for d in (h, -h))
    assert float(gradient) == pytest.approx((up - down) / (2 * h), rel=1e-6)
    assert abs(float(gradient)) > 1e-7
