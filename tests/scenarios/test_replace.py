"""A scenario with other parts, alone and many at once."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from slidax import scenarios
from slidax.core.errors import DefinitionError
from slidax.core.types import State
from slidax.motions import ConstantPosture
from slidax.simulation import native_engine

BASE = scenarios.load("example-4.1").replace(t1=0.05, mode="held", period=1e-3)
GAINS = jnp.array([0.1, 0.3])


def with_gain(scenario, k1):
    return scenario.replace(controller=eqx.tree_at(lambda c: c.surface.k1, scenario.controller, k1))


def test_parts_times_and_stepping_are_replaced_and_the_rest_stays():
    before = scenarios.load("example-4.1")
    after = before.replace(state0=State([0.3, 2.4]), t1=0.05, period=1e-3, mode="held")
    assert (after.t1, after.period, after.stepping.mode) == (0.05, 1e-3, "held")
    assert (before.t1, before.stepping.mode) == (10.0, "continuous")
    assert after.controller is before.controller and after.stepping.integrator is before.stepping.integrator
    assert after.changed == ("state0", "t1", "period", "mode")
    assert int(after.simulate().tally.samples) == 51


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            {"trajectory": ConstantPosture([0.0, 0.0, 0.0])},
            r"the trajectory gives \[3\] positions",
        ),
        ({"state0": State([0.0])}, "`state0.q` must have one entry for each of the 2 joints"),
        ({"controler": None}, "a scenario has no field `controler`; did you mean `controller`?"),
        ({"period": -1.0}, "`Stepping.period` must be > 0 s"),
    ],
)
def test_parts_that_do_not_fit_are_refused(change, message):
    with pytest.raises(DefinitionError, match=message):
        BASE.replace(**change)


def test_many_at_once_are_each_alone():
    runs = BASE.simulate_batch(with_gain, GAINS, log_every=1)
    for run, k1 in zip(runs, GAINS, strict=True):
        alone = with_gain(BASE, k1).simulate(log_every=1)
        for many, one in zip(jax.tree.leaves(run), jax.tree.leaves(alone), strict=True):
            np.testing.assert_array_equal(many, one)
    assert np.any(runs[0].tally.last_torque != runs[1].tally.last_torque)


def test_the_same_batch_is_compiled_once():
    BASE.simulate_batch(with_gain, GAINS, log_every=1)
    before = native_engine._compiled_batch.cache_info().misses
    BASE.simulate_batch(with_gain, GAINS, log_every=1)
    assert native_engine._compiled_batch.cache_info().misses == before


def test_all_runs_of_a_batch_pass_through_the_same_time():
    with pytest.raises(DefinitionError, match="all runs of a batch have one `t1` and one stepping"):
        BASE.simulate_batch(lambda scenario, k1: with_gain(scenario, k1).replace(t1=0.1), GAINS)
