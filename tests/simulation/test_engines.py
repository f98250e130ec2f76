"""Machine code of our own and XLA give the same runs; XLA is the reference."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from slidax import scenarios
from slidax._errors import DefinitionError, OutcomeError
from slidax._types import Command, State
from slidax.codegen import llvm
from slidax.codegen.trace import NoNativeCodeError
from slidax.controllers import AbstractController
from slidax.simulation import simulate
from slidax.simulation.engine import engine_for
from slidax.trajectories import MinimumJerk
from tests.paper import MOTION_4_1, START_4_1, law_4_1, plant_4_1
from tests.simulation.simple import SMOOTH_PLANT, SPRING

# Every kind of plant and law: stages, substeps, sensors with noise, delay and losses, limits with dead time,
# estimators, memories with and without a rate.
LOOPS = {
    "continuous": ("example-4.1", {"simulation.t1": 0.3}),
    "held, three joints": ("example-4.2", {"simulation.t1": 0.3, "simulation.mode": "held"}),
    "sampled data": ("example-4.1-1khz", {"simulation.t1": 0.5}),
    "encoders with noise": (
        "example-4.2-1khz",
        {
            "simulation.t1": 0.3,
            "sensor.resolution": 1e-5,
            "sensor.position_noise": 1e-6,
            "sensor.velocity": "differenced",
            "sensor.seed": 3,
        },
    ),
    "lost samples": ("example-4.1-1khz", {"simulation.t1": 0.3, "sensor.loss.probability": 0.2}),
    **{
        name: ("example-4.1", {"simulation.t1": 0.2, "simulation.mode": "held", "scheme.name": name})
        for name in ("anftsmc", "nftsmc", "super_twisting", "slotine_li_ppc", "sfsmc", "computed_torque")
    },
}


def both(name, **more):
    scenario, changes = LOOPS[name]
    runs = []
    for engine in ("native", "xla"):
        loop = scenarios.load(scenario, {**changes, "simulation.engine": engine})
        runs.append(loop.simulate(**more))
    return runs


@pytest.mark.parametrize("name", LOOPS)
def test_both_engines_give_the_same_run(name):
    """To what rounding makes of it: chattering torques apart, states to 1e-9 of their size."""
    native, xla = both(name, log_every=7)
    assert native.outcome == xla.outcome
    assert native.log.k.tolist() == xla.log.k.tolist()
    np.testing.assert_allclose(native.log.state.q, xla.log.state.q, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(native.log.reference.q, xla.log.reference.q, rtol=1e-13, atol=1e-15)
    np.testing.assert_allclose(native.tally.peak_torque, xla.tally.peak_torque, rtol=1e-9)
    np.testing.assert_allclose(native.tally.torque_travel, xla.tally.torque_travel, rtol=1e-5)
    assert set(native.log.signals) == set(xla.log.signals)
    same = [jax.tree.structure(run) for run in (native.tally, xla.tally)]
    assert same[0] == same[1]
    for ours, theirs in zip(jax.tree.leaves(native.tally), jax.tree.leaves(xla.tally), strict=True):
        assert (ours.shape, ours.dtype) == (theirs.shape, theirs.dtype)


def test_example_4_1_is_the_same_to_1e_9_over_its_whole_length_where_it_does_not_chatter():
    def run(engine):
        loop = plant_4_1(), law_4_1(), MOTION_4_1, START_4_1
        return simulate(*loop, t1=10.0, period=1e-4, mode="continuous", log_every=50, engine=engine)

    native, xla = run("native"), run("xla")
    assert native.outcome.ok
    assert native.tally.samples == xla.tally.samples
    np.testing.assert_allclose(native.log.state.q, xla.log.state.q, rtol=0, atol=1e-9)
    np.testing.assert_allclose(native.log.tau, xla.log.tau, rtol=0, atol=1e-6)
    np.testing.assert_allclose(native.tally.torque_travel, xla.tally.torque_travel, rtol=1e-9)


def test_a_motion_through_waypoints_is_the_same():
    motion = MinimumJerk.through([0.0, 0.3, 0.5], [[0.0, 1.0], [0.2, 0.8], [0.1, 0.9]])
    native, xla = (
        simulate(SMOOTH_PLANT, SPRING, motion, START_4_1, t1=0.6, period=0.01, engine=engine)
        for engine in ("native", "xla")
    )
    np.testing.assert_allclose(native.log.reference.q, xla.log.reference.q, rtol=1e-13)
    np.testing.assert_allclose(native.log.state.q, xla.log.state.q, rtol=1e-11)


@pytest.mark.parametrize("engine", ["native", "xla"])
def test_the_same_inputs_give_the_same_bits(engine):
    def bits():
        run = simulate(plant_4_1(), law_4_1(), MOTION_4_1, START_4_1, t1=0.2, period=1e-3, log_every=1, engine=engine)
        return [np.asarray(leaf).tobytes() for leaf in jax.tree.leaves((run.log, run.tally, run.state))]

    assert bits() == bits()


def test_what_is_logged_changes_no_bit_of_a_native_run():
    def bits(log_every):
        run = simulate(
            plant_4_1(), law_4_1(), MOTION_4_1, START_4_1, t1=2.0, period=1e-3, log_every=log_every, engine="native"
        )
        return [np.asarray(leaf).tobytes() for leaf in jax.tree.leaves((run.tally, run.state))]

    assert bits(None) == bits(1) == bits(9)


@pytest.mark.parametrize("mode", ["held", "continuous"])
def test_a_bad_end_is_the_same_end(mode):
    runs = [
        simulate(plant_4_1(), law_4_1(), MOTION_4_1, START_4_1, t1=9.0, period=4e-3, mode=mode, engine=engine)
        for engine in ("native", "xla")
    ]
    assert not runs[0].outcome.ok
    assert [run.outcome.kind for run in runs] == [runs[0].outcome.kind] * 2
    for run in runs:
        assert len(run.log.t) == int(run.tally.samples)
        assert all(np.isfinite(leaf).all() for leaf in jax.tree.leaves((run.log, run.tally.torque_travel)))
    with pytest.raises(OutcomeError):
        simulate(
            plant_4_1(), law_4_1(), MOTION_4_1, START_4_1, t1=9.0, period=4e-3, mode=mode, engine="native", throw=True
        )


def test_a_start_outside_the_envelope_is_refused_by_both():
    start = State(q=jnp.array([5.0, 2.5]), dq=jnp.zeros(2))
    for engine in ("native", "xla"):
        with pytest.raises(DefinitionError, match="must start inside the envelope"):
            simulate(plant_4_1(), law_4_1(), MOTION_4_1, start, t1=0.1, period=1e-3, engine=engine)


def test_an_unknown_engine_is_refused_with_the_names_of_those_there_are():
    with pytest.raises(DefinitionError, match="`auto`, `native`, `xla`; got 'fast'"):
        engine_for("fast")


class Sorting(AbstractController):
    """A law with a primitive that no native code is there for."""

    joints: int = 2

    def init(self, t, state, reference):
        return ()

    def __call__(self, t, state, reference_now, reference_next, memory):
        return Command(tau=jnp.sort(reference_now.q - state.q), memory=memory, signals={})

    def envelope(self, t, memory):
        return None


def test_a_law_without_native_code_runs_by_xla_with_a_word_about_it():
    loop = SMOOTH_PLANT, Sorting(), MOTION_4_1, START_4_1
    with pytest.warns(UserWarning, match="engine `xla`, as there is no native code for the JAX primitive `sort`"):
        auto = simulate(*loop, t1=0.1, period=0.01)
    xla = simulate(*loop, t1=0.1, period=0.01, engine="xla")
    np.testing.assert_array_equal(auto.tally.torque_square, xla.tally.torque_square)
    with pytest.raises(NoNativeCodeError, match="`sort`"):
        simulate(*loop, t1=0.1, period=0.01, engine="native")


def test_without_llvmlite_a_run_goes_by_xla_and_says_so_if_it_was_to_be_native(monkeypatch):
    monkeypatch.setattr(llvm, "available", lambda: False)
    loop = SMOOTH_PLANT, SPRING, MOTION_4_1, START_4_1
    with pytest.warns(UserWarning, match=r"llvmlite is not installed: pip install 'slidax\[native\]'"):
        asked = simulate(*loop, t1=0.1, period=0.01, engine="native")
    auto = simulate(*loop, t1=0.1, period=0.01)
    xla = simulate(*loop, t1=0.1, period=0.01, engine="xla")
    np.testing.assert_array_equal(asked.tally.torque_square, xla.tally.torque_square)
    np.testing.assert_array_equal(auto.tally.torque_square, xla.tally.torque_square)
