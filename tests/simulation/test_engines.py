"""The native engine and XLA give the same runs; XLA is the reference."""

import warnings
from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from slidax import scenarios
from slidax.codegen import NoNativeCodeError, llvm
from slidax.codegen.builder import Builder
from slidax.codegen.llvm import machine
from slidax.codegen.trace.tracing import PLAIN
from slidax.core.errors import DefinitionError, OutcomeError
from slidax.core.types import Command, State
from slidax.law import AbstractController
from slidax.motions import MinimumJerk
from slidax.simulation import native_engine, simulate, simulate_batch
from slidax.simulation.engine import engine_for
from tests.paper_examples import MOTION_4_1, START_4_1, law_4_1, plant_4_1
from tests.simulation.simple import SMOOTH_PLANT, SPRING

# Every kind of plant and law: stages, substeps, sensors with noise, delay and losses, limits with dead time,
# estimators, memories with and without a rate.
LOOPS = {
    "continuous": ("example-4.1", {"simulation.t1": 0.3}),
    "held, three joints": ("example-4.2", {"simulation.t1": 0.3, "simulation.mode": "held"}),
    "sampled data": ("example-4.1-1khz", {"simulation.t1": 0.5}),
    "encoders with noise and lost samples": (
        "example-4.2-1khz",
        {
            "simulation.t1": 0.3,
            "sensor.resolution": 1e-5,
            "sensor.position_noise": 1e-6,
            "sensor.velocity": "differenced",
            "sensor.seed": 3,
            "sensor.loss.probability": 0.2,
        },
    ),
    "at mid-period with lost samples": (
        "panda-payload",
        {
            "simulation.t1": 0.2,
            "robot.nominal.viscous": 0.2,
            "sensor.delay": 2.0,
            "sensor.loss.probability": 0.2,
            "scheme.sampled_data.midpoint": True,
            "scheme.sampled_data.viscous_feedforward": True,
        },
    ),
    **{
        name: ("example-4.1", {"simulation.t1": 0.2, "simulation.mode": "held", "scheme.name": name})
        for name in ("anftsmc", "nftsmc", "super_twisting", "slotine_li_ppc", "sfsmc", "computed_torque")
    },
}


def both(name, **more):
    scenario, changes = LOOPS[name]
    loops = [scenarios.load(scenario, {**changes, "simulation.engine": engine}) for engine in ("native", "xla")]
    return [loop.simulate(**more) for loop in loops]


# Of similar loops, one runs daily; `test_random_scenarios` mixes all of them.
DAILY = ("held, three joints", "anftsmc")


@pytest.mark.parametrize("name", [pytest.param(n, marks=[] if n in DAILY else [pytest.mark.full]) for n in LOOPS])
def test_both_engines_give_the_same_run(name):
    """The runs agree up to rounding, which grows in chattering torques: of these, peaks and travel are compared."""
    native, xla = both(name, log_every=7)
    assert native.outcome == xla.outcome
    assert native.log.k.tolist() == xla.log.k.tolist()
    np.testing.assert_allclose(native.log.state.q, xla.log.state.q, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(native.log.reference.q, xla.log.reference.q, rtol=1e-13, atol=1e-15)
    np.testing.assert_allclose(native.tally.peak_torque, xla.tally.peak_torque, rtol=1e-9)
    np.testing.assert_allclose(native.tally.torque_travel, xla.tally.torque_travel, rtol=1e-5)
    assert set(native.log.signals) == set(xla.log.signals)
    assert jax.tree.structure(native.tally) == jax.tree.structure(xla.tally)
    for ours, theirs in zip(jax.tree.leaves(native.tally), jax.tree.leaves(xla.tally), strict=True):
        assert (ours.shape, ours.dtype) == (theirs.shape, theirs.dtype)


@pytest.mark.full
def test_engines_agree_to_1e_9_over_example_4_1_without_chattering():
    def run(engine):
        loop = plant_4_1(), law_4_1(), MOTION_4_1, START_4_1
        return simulate(*loop, t1=10.0, period=1e-4, mode="continuous", log_every=50, engine=engine)

    native, xla = run("native"), run("xla")
    assert native.outcome.ok
    assert native.tally.samples == xla.tally.samples
    np.testing.assert_allclose(native.log.state.q, xla.log.state.q, rtol=0, atol=1e-9)
    np.testing.assert_allclose(native.log.tau, xla.log.tau, rtol=0, atol=1e-6)
    np.testing.assert_allclose(native.tally.torque_travel, xla.tally.torque_travel, rtol=1e-9)


def test_engines_agree_on_a_motion_through_waypoints():
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


@pytest.mark.parametrize("mode", ["held", "continuous"])
def test_both_engines_give_a_failing_run_the_same_outcome(mode):
    loop, times = (plant_4_1(), law_4_1(), MOTION_4_1, START_4_1), {"t1": 9.0, "period": 4e-3, "mode": mode}
    runs = [simulate(*loop, **times, engine=engine) for engine in ("native", "xla")]
    assert [(run.outcome.kind, run.outcome.joint) for run in runs] == [("left_envelope", 1)] * 2
    # The torque chatters, so that rounding moves the exit.
    assert runs[0].outcome.t == pytest.approx(runs[1].outcome.t, abs=0.02)
    for run in runs:
        assert len(run.log.t) == int(run.tally.samples)
        assert all(np.isfinite(leaf).all() for leaf in jax.tree.leaves((run.log, run.tally.torque_travel)))
    with pytest.raises(OutcomeError):
        simulate(*loop, **times, engine="native", throw=True)


def test_an_unknown_engine_is_refused_with_the_existing_names():
    with pytest.raises(DefinitionError, match="`auto`, `native`, `xla`, `cuda`; got 'fast'"):
        engine_for("fast")


class Written(AbstractController):
    """A law that is one function of the error."""

    law: Callable = eqx.field(static=True)
    joints: int = 2

    def init(self, t, state, reference):
        return ()

    def __call__(self, t, state, reference_now, reference_next, memory):
        return Command(tau=self.law(reference_now.q - state.q), memory=memory, signals={})

    def envelope(self, t, memory):
        return None


def soft(e):
    """The root of `τ + τ³ = e`, joint by joint."""

    def newton(f, x):
        return jax.lax.fori_loop(0, 25, lambda _, x: x - f(x) / jax.jvp(f, (x,), (jnp.ones_like(x),))[1], x)

    return jax.lax.custom_root(lambda x: x + x**3 - e, e, newton, lambda g, y: y / g(jnp.ones_like(y)))


def test_a_law_with_a_custom_solver_has_native_code():
    loop = SMOOTH_PLANT, Written(soft), MOTION_4_1, START_4_1
    native, xla = (simulate(*loop, t1=0.1, period=0.01, engine=engine) for engine in ("native", "xla"))
    np.testing.assert_allclose(native.log.tau, xla.log.tau, rtol=1e-12)


def with_its_warning(simulated):
    """Return the result of a simulation and its only warning."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        run = simulated()
    (message,) = [str(each.message) for each in caught]
    assert message.startswith("simulating with the engine `xla`, because there is no native code for ")
    assert "\n" not in message
    return run, message


def test_a_law_without_native_code_runs_by_xla_with_one_warning():
    def law(e):
        return jax.lax.custom_root(lambda x: x - e, e, lambda f, x: jnp.sort(x - f(x)), lambda g, y: y)

    loop, times = (SMOOTH_PLANT, Written(law), MOTION_4_1, START_4_1), {"t1": 0.1, "period": 0.01}
    auto, message = with_its_warning(lambda: simulate(*loop, **times))
    assert "the JAX primitive `sort` (line " in message
    xla = simulate(*loop, **times, engine="xla")
    np.testing.assert_array_equal(auto.tally.torque_square, xla.tally.torque_square)
    with pytest.raises(NoNativeCodeError, match="the JAX primitive `sort` \\(line "):
        simulate(*loop, **times, engine="native")


def starts(shift):
    return SMOOTH_PLANT, SPRING, MOTION_4_1, State(q=START_4_1.q + shift, dq=START_4_1.dq)


@pytest.mark.parametrize("where", ["rule", *(pytest.param(w, marks=pytest.mark.full) for w in ("builder", "compiler"))])
def test_any_native_compiler_failure_is_reported_and_the_run_uses_xla(monkeypatch, where):
    def fails(*_, **__):
        raise AssertionError("never thought of")

    if where == "rule":
        monkeypatch.setitem(PLAIN, "sin", fails)
    elif where == "builder":
        monkeypatch.setattr(Builder, "loop", fails)
    else:
        monkeypatch.setattr(machine.Machine, "code_of", fails)
    # No compiled loop is cached.
    monkeypatch.setattr(native_engine, "_compiled", native_engine._compiled.__wrapped__)
    monkeypatch.setattr(native_engine, "_compiled_batch", native_engine._compiled_batch.__wrapped__)
    how = {"t1": 0.1, "period": 0.01}
    single, message = with_its_warning(lambda: simulate(*starts(0.0), **how))
    assert message.endswith(": AssertionError: never thought of")
    many, message = with_its_warning(lambda: simulate_batch(starts, jnp.array([0.0, 0.1]), **how))
    assert message.endswith(": AssertionError: never thought of")
    np.testing.assert_allclose(many.tally.torque_square[0], single.tally.torque_square, rtol=1e-12)
    for run in (
        lambda: simulate(*starts(0.0), **how, engine="native"),
        lambda: simulate_batch(starts, jnp.array([0.0]), **how, engine="native"),
    ):
        with pytest.raises(NoNativeCodeError, match=r"^no native code for .*: AssertionError: never thought of$"):
            run()


def test_an_error_in_the_law_is_raised_with_its_line():
    def wrong(e):
        return e @ jnp.ones(3)

    with pytest.raises(DefinitionError, match=r"line \d+ of .*test_engines.py, in .*wrong`: TypeError: .*shape"):
        simulate(SMOOTH_PLANT, Written(wrong), MOTION_4_1, START_4_1, t1=0.1, period=0.01)


def test_a_run_without_llvmlite_uses_xla_and_warns_if_native_was_requested(monkeypatch):
    monkeypatch.setattr(llvm, "available", lambda: False)
    loop = SMOOTH_PLANT, SPRING, MOTION_4_1, START_4_1
    with pytest.warns(UserWarning, match=r"llvmlite is not installed: pip install 'slidax\[native\]'"):
        native = simulate(*loop, t1=0.1, period=0.01, engine="native")
    auto = simulate(*loop, t1=0.1, period=0.01)
    xla = simulate(*loop, t1=0.1, period=0.01, engine="xla")
    np.testing.assert_array_equal(native.tally.torque_square, xla.tally.torque_square)
    np.testing.assert_array_equal(auto.tally.torque_square, xla.tally.torque_square)
