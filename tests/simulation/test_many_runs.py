"""Many runs as one: how many, which came to what, and each as if it were alone."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from slidax.core.errors import DefinitionError
from slidax.core.types import State
from slidax.motions import ConstantPosture
from slidax.simulation import simulate, simulate_batch
from tests.simulation.simple import SMOOTH_PLANT, BoundedLaw, Spring

HOW = {"t1": 0.4, "period": 0.04, "log_every": 1}
RADII = jnp.array([0.095, 10.0, 0.135])


def falling(radius):
    law = BoundedLaw(Spring(jnp.zeros(2), jnp.zeros(2)), radius)
    return SMOOTH_PLANT, law, ConstantPosture([np.pi / 2, 0.0]), State([np.pi / 2, 0.0], [1.0, 0.0])


@pytest.fixture(scope="module", params=["native", "xla"])
def runs(request):
    return simulate_batch(falling, RADII, **HOW, engine=request.param)


def test_each_run_has_its_outcome(runs):
    alone = [simulate(*falling(radius), **HOW).outcome for radius in RADII]
    assert [outcome.kind for outcome in runs.outcomes] == ["left_envelope", "ok", "left_envelope"]
    for many, one in zip(runs.outcomes, alone, strict=True):
        assert (many.kind, many.joint, many.t, many.bound) == (one.kind, one.joint, one.t, one.bound)
    assert [run.outcome for run in runs] == runs.outcomes


@pytest.mark.parametrize("which", [0, 1, -1])
def test_one_of_many_is_the_run_alone(which):
    runs = simulate_batch(falling, RADII, **HOW, engine="native")
    alone = simulate(*falling(RADII[which]), **HOW, engine="native")
    assert runs[which].outcome == alone.outcome
    for many, one in zip(jax.tree.leaves(runs[which]), jax.tree.leaves(alone), strict=True):
        assert (many.shape, many.dtype) == (one.shape, one.dtype)
        np.testing.assert_array_equal(many, one)


def test_they_are_counted_picked_and_gone_through(runs):
    assert len(runs) == 3 == len(list(runs))
    assert [len(run.log.t) for run in runs] == [3, 11, 4]
    assert len(runs[1:]) == 2
    assert runs[1:][0].outcome == runs[1].outcome
    with pytest.raises(IndexError, match="there are 3 runs; got 3"):
        runs[3]


def test_one_outcome_of_many_is_refused_with_the_remedy(runs):
    with pytest.raises(DefinitionError, match="these are 3 runs: see `outcomes`"):
        _ = runs.outcome


def test_a_single_run_is_no_sequence_but_has_outcomes():
    one = simulate(*falling(RADII[1]), **HOW)
    assert one.outcomes == [one.outcome]
    assert bool(one)
    with pytest.raises(TypeError, match="a single run has no length"):
        len(one)


def test_inside_a_transformation_there_is_no_outcome_yet():
    def inside(radius):
        run = simulate(*falling(radius), **HOW)
        with pytest.raises(DefinitionError, match="look at `fault`"):
            _ = run.outcome
        return run

    assert [outcome.kind for outcome in jax.vmap(inside)(RADII).outcomes][1] == "ok"


def test_they_stay_a_tree_of_arrays(runs):
    worst = jax.jit(jax.vmap(lambda run: jnp.max(run.tally.peak_torque)))(runs)
    np.testing.assert_array_equal(worst, np.max(runs.tally.peak_torque, axis=1))
    assert jax.jit(lambda runs: runs)(runs).outcomes == runs.outcomes
