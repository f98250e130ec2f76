"""Batches equal single runs with either engine, with any number of threads, and in `vmap`, `jit` and `grad`."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from slidax.core.errors import DefinitionError
from slidax.core.types import State
from slidax.motions import ConstantPosture
from slidax.plant import DifferencedEncoders, Encoders
from slidax.simulation import Plant, simulate, simulate_batch
from tests.enrolled import assert_same, assert_same_numbers
from tests.paper_examples import DISTURBANCE_4_1, MOTION_4_1, START_4_1, TWO_LINK, law_4_1, plant_4_1
from tests.simulation.simple import SMOOTH_PLANT, SPRING, BoundedLaw, Spring

HOW = {"t1": 0.4, "period": 0.04, "log_every": 1}
RADII = jnp.array([0.095, 10.0, 0.135])


def falling(radius):
    law = BoundedLaw(Spring(jnp.zeros(2), jnp.zeros(2)), radius)
    return SMOOTH_PLANT, law, ConstantPosture([np.pi / 2, 0.0]), State([np.pi / 2, 0.0], [1.0, 0.0])


@pytest.fixture(scope="module", params=["native", "xla"])
def runs(request):
    return simulate_batch(falling, RADII, **HOW, engine=request.param)


def test_each_run_of_a_batch_has_its_outcome(runs):
    alone = [simulate(*falling(radius), **HOW).outcome for radius in RADII]
    assert [outcome.kind for outcome in runs.outcomes] == ["left_envelope", "ok", "left_envelope"]
    for ours, theirs in zip(runs.outcomes, alone, strict=True):
        assert (ours.kind, ours.joint, ours.t, ours.bound) == (theirs.kind, theirs.joint, theirs.t, theirs.bound)
    assert [run.outcome for run in runs] == runs.outcomes
    assert (runs.fault.kind.tolist(), runs.fault.joint.tolist()) == ([1, 0, 1], [0, 0, 0])
    assert runs.fault.absent.tolist() == [False, True, False]
    np.testing.assert_allclose(runs.fault.t[::2], [0.12, 0.16], atol=1e-12)
    np.testing.assert_allclose(runs.fault.bound[::2], [0.095, 0.135])
    assert runs.tally.violations.tolist() == [1, 0, 1]
    leaves = jax.tree.leaves((runs.log, runs.state, runs.tally.torque_square, runs.tally.late_error))
    assert all(np.all(np.isfinite(leaf)) for leaf in leaves)


@pytest.mark.parametrize("which", [0, 1, -1])
def test_an_indexed_run_of_a_batch_equals_the_single_run_with_its_outcome(which):
    runs = simulate_batch(falling, RADII, **HOW, engine="native")
    alone = simulate(*falling(RADII[which]), **HOW, engine="native")
    assert runs[which].outcome == alone.outcome
    for ours, theirs in zip(jax.tree.leaves(runs[which]), jax.tree.leaves(alone), strict=True):
        assert (ours.shape, ours.dtype) == (theirs.shape, theirs.dtype)
        np.testing.assert_array_equal(ours, theirs)


def test_a_batch_supports_length_indexing_slicing_and_iteration(runs):
    assert len(runs) == 3 == len(list(runs))
    assert [len(run.log.t) for run in runs] == [3, 11, 4] == np.sum(runs.log.valid, axis=1).tolist()
    assert runs.tally.samples.tolist() == [3, 11, 4]
    assert len(runs[1:]) == 2 and runs[1:][0].outcome == runs[1].outcome
    with pytest.raises(IndexError, match="there are 3 runs; got 3"):
        runs[3]
    with pytest.raises(DefinitionError, match="a batch of 3 runs has no single outcome: read `outcomes`"):
        _ = runs.outcome


def test_a_single_run_has_outcomes_but_no_length():
    run = simulate(*falling(RADII[1]), **HOW)
    assert run.outcomes == [run.outcome] and bool(run)
    with pytest.raises(TypeError, match="a single run has no length"):
        len(run)


def test_a_run_inside_a_jax_transformation_has_no_outcome():
    def inside(radius):
        run = simulate(*falling(radius), **HOW)
        with pytest.raises(DefinitionError, match="read `fault`"):
            _ = run.outcome
        return run

    assert [outcome.kind for outcome in jax.vmap(inside)(RADII).outcomes][1] == "ok"


def test_a_batch_of_runs_is_a_pytree_for_jit_and_vmap(runs):
    worst = jax.jit(jax.vmap(lambda run: jnp.max(run.tally.peak_torque)))(runs)
    np.testing.assert_array_equal(worst, np.max(runs.tally.peak_torque, axis=1))
    assert jax.jit(lambda runs: runs)(runs).outcomes == runs.outcomes


TIMES = {"t1": 0.4, "period": 1e-3}


def shifted(x):
    k2, shift = x
    law = eqx.tree_at(lambda c: c.surface.k2, law_4_1(), k2)
    return plant_4_1(), law, MOTION_4_1, State(q=START_4_1.q + shift, dq=START_4_1.dq)


VARIED = (jnp.linspace(0.4, 0.8, 11), jnp.linspace(-0.02, 0.02, 11))


def test_a_run_of_a_native_batch_has_the_bits_of_the_single_run():
    many = simulate_batch(shifted, VARIED, **TIMES, log_every=50, engine="native")
    for i in (0, 5, 10):
        alone = simulate(*shifted((VARIED[0][i], VARIED[1][i])), **TIMES, log_every=50, engine="native")
        for a, b in zip(
            jax.tree.leaves((many.tally, many.log)), jax.tree.leaves((alone.tally, alone.log)), strict=True
        ):
            np.testing.assert_array_equal(np.asarray(a)[i], b)


@pytest.mark.full
def test_both_engines_give_the_same_batch():
    native, xla = (
        simulate_batch(shifted, VARIED, **TIMES, log_every=20, engine=engine) for engine in ("native", "xla")
    )
    assert jax.tree.structure(native) == jax.tree.structure(xla)
    for ours, theirs in zip(jax.tree.leaves(native), jax.tree.leaves(xla), strict=True):
        assert (ours.shape, ours.dtype) == (theirs.shape, theirs.dtype)
        np.testing.assert_allclose(ours, theirs, rtol=1e-8, atol=1e-9)


def test_the_number_of_threads_changes_no_bit():
    once, twice = (simulate_batch(shifted, VARIED, **TIMES, engine="native", threads=threads) for threads in (1, 2))
    assert_same_numbers(once, twice)


def test_each_run_has_its_own_random_numbers():
    def noisy(seed):
        sensor = DifferencedEncoders(resolution=1e-5, position_noise=1e-5, seed=seed)
        return Plant(TWO_LINK, DISTURBANCE_4_1, sensor), SPRING, MOTION_4_1, START_4_1

    seeds = jnp.array([0, 7, 7])
    native, xla = (simulate_batch(noisy, seeds, t1=0.1, period=1e-3, engine=engine) for engine in ("native", "xla"))
    np.testing.assert_allclose(native.tally.torque_travel, xla.tally.torque_travel, rtol=1e-6)
    assert np.all(native.tally.torque_travel[0] != native.tally.torque_travel[1])
    np.testing.assert_array_equal(native.tally.torque_travel[1], native.tally.torque_travel[2])


@pytest.mark.full
def test_a_batch_inside_jit_equals_the_batch_outside():
    def error(gain):
        return simulate_batch(shifted, (gain, jnp.zeros(2)), t1=0.05, period=1e-3).tally.steady_error

    inside = jax.jit(error)(jnp.array([0.5, 0.6]))
    np.testing.assert_allclose(inside, error(jnp.array([0.5, 0.6])), rtol=1e-9)


@pytest.mark.parametrize("varied", [(), jnp.zeros(()), (jnp.zeros(3), jnp.zeros(2)), jnp.zeros((0, 2))])
def test_varied_arrays_without_a_common_first_axis_are_refused(varied):
    with pytest.raises(DefinitionError, match="first axis"):
        simulate_batch(shifted, varied, **TIMES)


def run(layer, shift):
    law = eqx.tree_at(lambda c: c.reaching.layer, law_4_1(), layer)
    start = State(q=START_4_1.q + shift, dq=START_4_1.dq)
    return simulate(plant_4_1(), law, MOTION_4_1, start, t1=1.0, period=1e-3, log_every=10)


def test_vmapped_runs_equal_single_runs():
    """Metrics agree to a relative 1e-9, torques to 1e-6, counts and faults exactly."""
    layers, shifts = jnp.array([0.1, 0.3]), jnp.array([0.0, 0.02])
    many = jax.jit(jax.vmap(run))(layers, shifts)
    for i, (layer, shift) in enumerate(zip(layers, shifts, strict=True)):
        alone, ours = run(layer, shift), jax.tree.map(lambda x, i=i: x[i], many)
        assert_same(ours.tally, alone.tally, rtol=1e-9, atol=0.0)
        assert int(ours.fault.kind) == int(alone.fault.kind)
        np.testing.assert_allclose(ours.log.tau, alone.log.tau, rtol=1e-6, atol=1e-6)
        assert int(np.sum(ours.log.valid)) == len(alone.log.t) == 101


@pytest.mark.parametrize(
    ("sensor", "law", "gain", "step"),
    [
        (Encoders(1e-4), SPRING, lambda law: law.stiffness, 1e-2),
        pytest.param(DifferencedEncoders(1e-5), SPRING, lambda law: law.stiffness, 1e-2, marks=pytest.mark.full),
        pytest.param(Encoders(1e-4), law_4_1(), lambda law: law.surface.k1, 1e-4, marks=pytest.mark.full),
    ],
    ids=["encoders", "differenced", "encoders and the paper's law"],
)
def test_the_gradient_through_encoders_equals_that_of_the_loop_without_quantization(sensor, law, gain, step):
    """Without the straight-through derivative, the errors of the three gradients are 7 %, a third and 1.5 %."""

    def squared_error(change, sensor):
        changed = eqx.tree_at(gain, law, gain(law) + change)
        plant = Plant(TWO_LINK, SMOOTH_PLANT.disturbance, sensor)
        log = simulate(plant, changed, MOTION_4_1, START_4_1, t1=0.2, period=1e-3).log
        return jnp.sum(jnp.square(log.state.q - log.reference.q))

    slope = jax.jit(jax.grad(lambda change: squared_error(change, sensor)))(jnp.zeros(()))
    exact = eqx.tree_at(lambda s: s.resolution, sensor, jnp.zeros(()))
    up, down = jax.jit(jax.vmap(lambda change: squared_error(change, exact)))(jnp.array([step, -step]))
    assert float(slope) == pytest.approx(float(up - down) / (2 * step), rel=1e-4)


def final_error_and_effort(law, mode="held"):
    done = simulate(plant_4_1(), law, MOTION_4_1, START_4_1, t1=0.2, period=1e-3, mode=mode, log_every=None)
    effort = jnp.sum(done.tally.torque_square) + jnp.sum(done.tally.late_error) + jnp.sum(done.tally.torque_travel)
    return jnp.stack([jnp.sum(jnp.abs(done.state.q - MOTION_4_1.position(jnp.asarray(0.2)))), effort])


@pytest.mark.parametrize("mode", ["held", pytest.param("continuous", marks=pytest.mark.full)])
def test_gradients_match_finite_differences(mode):
    def final_error(k2):
        return final_error_and_effort(eqx.tree_at(lambda c: c.surface.k2, law_4_1(), k2), mode)[0]

    h = 1e-5
    gains = jnp.array([0.6, 0.6 + h, 0.6 - h])
    value_and_slope = jax.jit(jax.vmap(lambda k: jax.jvp(final_error, (k,), (jnp.ones(()),))))
    (_, up, down), (forward, _, _) = value_and_slope(gains)
    difference = float(up - down) / (2 * h)
    assert np.isfinite(forward)
    assert abs(difference) > 1e-3
    assert float(forward) == pytest.approx(difference, rel=1e-6)


# Reverse mode through a whole run takes long to compile; a test above uses it with a simpler law.
@pytest.mark.full
def test_gradients_with_respect_to_all_gains_are_finite_and_mostly_nonzero():
    def final_error(k2):
        return final_error_and_effort(eqx.tree_at(lambda c: c.surface.k2, law_4_1(), k2))[0]

    k2 = jnp.asarray(0.6)
    forward = jax.jit(jax.jacfwd(final_error))(k2)
    reverse = jax.jit(jax.jacrev(final_error_and_effort))(eqx.tree_at(lambda c: c.surface.k2, law_4_1(), k2))
    assert float(reverse.surface.k2[0]) == pytest.approx(float(forward), rel=1e-9)
    leaves = [np.asarray(leaf) for leaf in jax.tree.leaves(reverse)]
    assert all(np.all(np.isfinite(leaf)) for leaf in leaves)
    assert sum(np.any(leaf[1] != 0) for leaf in leaves) >= 15


@pytest.mark.full
def test_the_gradient_with_respect_to_a_link_mass_matches_finite_differences():
    """Identification and design need gradients with respect to the plant's parameters, too."""

    def final_angle(plant):
        end = simulate(plant, SPRING, MOTION_4_1, START_4_1, t1=0.3, period=0.01, log_every=None)
        return end.state.q[0]

    gradient = jax.jit(jax.grad(final_angle))(SMOOTH_PLANT)
    h = 1e-5

    def shifted(d):
        plant = eqx.tree_at(lambda p: p.robot.masses, SMOOTH_PLANT, SMOOTH_PLANT.robot.masses + jnp.array([0.0, d]))
        return float(final_angle(plant))

    difference = (shifted(h) - shifted(-h)) / (2 * h)
    assert float(gradient.robot.masses[1]) == pytest.approx(difference, rel=1e-6)


def test_a_sweep_over_gains_is_compiled_once():
    traces = []

    @jax.jit
    @jax.vmap
    def many(k2):
        traces.append(1)
        law = eqx.tree_at(lambda c: c.surface.k2, law_4_1(), k2)
        done = simulate(plant_4_1(), law, MOTION_4_1, START_4_1, t1=0.1, period=1e-3, log_every=None)
        return done.tally.torque_square

    for factor in (1.0, 1.1, 1.2):
        many(jnp.array([0.4, 0.6, 0.8]) * factor)
    assert len(traces) == 1
