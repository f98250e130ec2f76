"""The engine for a card: a whole closed loop as a kernel, run on the processor where there is no card."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from slidax import scenarios
from slidax.codegen import cuda
from slidax.core.errors import DefinitionError
from slidax.core.types import State
from slidax.motions import ConstantPosture
from slidax.simulation import native_engine, simulate, simulate_batch
from tests.codegen.card_on_the_processor import CardOnTheProcessor, needs_gxx
from tests.paper_examples import MOTION_4_1, START_4_1, plant_4_1
from tests.simulation.simple import SMOOTH_PLANT, SPRING, BoundedLaw, Spring
from tests.simulation.test_simulate_batch import VARIED, shifted

LOGGED = {"t1": 0.1, "period": 1e-3, "log_every": 20}


@pytest.fixture
def card(monkeypatch, tmp_path):
    """Something that takes the kernel's text as a card would; a list of the programs that it was given."""
    given = []

    def compile(program):
        given.append(program)
        return CardOnTheProcessor(program, tmp_path)

    monkeypatch.setattr(cuda, "compile_cuda", compile)
    monkeypatch.setattr(cuda, "require_card", lambda: None)
    yield given
    native_engine._compiled_for_card.cache_clear()


def assert_equal(one, other):
    assert jax.tree.structure(one) == jax.tree.structure(other)
    for ours, theirs in zip(jax.tree.leaves(one), jax.tree.leaves(other), strict=True):
        np.testing.assert_array_equal(ours, theirs)


@needs_gxx
def test_a_batch_on_a_card_has_the_very_bits_of_the_native_engine(card):
    card_s, processor_s = (simulate_batch(shifted, VARIED, **LOGGED, engine=engine) for engine in ("cuda", "native"))
    assert len(card) == 1
    assert_equal(card_s, processor_s)


@needs_gxx
def test_runs_that_end_early_end_alike(card):
    def bounded(radius):
        law = BoundedLaw(Spring(jnp.zeros(2), jnp.zeros(2)), radius)
        start = State(q=jnp.array([np.pi / 2, 0.0]), dq=jnp.array([1.0, 0.0]))
        return SMOOTH_PLANT, law, ConstantPosture([np.pi / 2, 0.0]), start

    done = simulate_batch(bounded, jnp.array([0.095, 10.0, 0.135]), t1=0.4, period=0.04, engine="cuda")
    assert done.fault.kind.tolist() == [1, 0, 1]
    assert_equal(done, simulate_batch(bounded, jnp.array([0.095, 10.0, 0.135]), t1=0.4, period=0.04, engine="native"))


@pytest.mark.full
@needs_gxx
def test_a_scenario_file_can_ask_for_it(card):
    changes = {"simulation.t1": 0.02}
    starts = jnp.array([[0.2, 0.8], [0.21, 0.79], [0.19, 0.8], [0.2, 0.81], [0.2, 0.78]])
    on_card, on_processor = (
        scenarios.load("example-4.1-1khz", {**changes, "simulation.engine": engine}).simulate_batch(
            lambda one, q: one.replace(state0=State(q, jnp.zeros(2))), starts
        )
        for engine in ("cuda", "native")
    )
    assert len(card) == 1
    assert_equal(on_card, on_processor)


def test_a_single_run_goes_by_the_processor_and_says_so():
    with pytest.warns(UserWarning, match="with the engine `native`, as `cuda` is for batches"):
        one = simulate(plant_4_1(), SPRING, MOTION_4_1, START_4_1, t1=0.01, period=1e-3, engine="cuda")
    assert_equal(one.tally, simulate(plant_4_1(), SPRING, MOTION_4_1, START_4_1, t1=0.01, period=1e-3).tally)


def test_without_a_card_a_batch_says_what_is_missing():
    if cuda.card_available():
        pytest.skip("there is a card")
    with pytest.raises(DefinitionError, match=r"slidax\[cuda\]|driver|no NVIDIA GPU"):
        simulate_batch(shifted, VARIED, t1=0.1, period=1e-3, engine="cuda")


def test_on_a_card_the_bits_are_those_of_the_native_engine():
    if not cuda.card_available():
        pytest.skip("CuPy or a card is missing")
    on_card, on_processor = (simulate_batch(shifted, VARIED, **LOGGED, engine=engine) for engine in ("cuda", "native"))
    assert_equal(on_card, on_processor)
