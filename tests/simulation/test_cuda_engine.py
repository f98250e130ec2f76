"""The CUDA engine: a whole closed loop as a kernel, emulated on the CPU where there is no GPU."""

import jax.numpy as jnp
import pytest

from slidax import scenarios
from slidax.codegen import cuda
from slidax.core.errors import DefinitionError
from slidax.core.types import State
from slidax.simulation import native_engine, simulate, simulate_batch
from tests.codegen.card_on_the_processor import CardOnTheProcessor, needs_gxx
from tests.enrolled import assert_same
from tests.paper_examples import MOTION_4_1, START_4_1, plant_4_1
from tests.simulation.simple import SPRING
from tests.simulation.test_batches import HOW, RADII, VARIED, falling, shifted

LOGGED = {"t1": 0.1, "period": 1e-3, "log_every": 20}


@pytest.fixture
def card(monkeypatch, tmp_path):
    """Emulate the GPU on the CPU, and return the list of its programs."""
    programs = []
    monkeypatch.setattr(
        cuda, "CudaKernel", lambda program: programs.append(program) or CardOnTheProcessor(program, tmp_path)
    )
    monkeypatch.setattr(cuda, "require_card", lambda: None)
    yield programs
    native_engine._compiled_for_card.cache_clear()


@needs_gxx
def test_a_batch_on_emulated_gpu_has_the_bits_of_the_native_engine(card):
    card_s, processor_s = (simulate_batch(shifted, VARIED, **LOGGED, engine=engine) for engine in ("cuda", "native"))
    assert len(card) == 1
    assert_same(card_s, processor_s)


@needs_gxx
def test_runs_that_end_early_on_emulated_gpu_equal_those_of_the_native_engine(card):
    done, expected = (simulate_batch(falling, RADII, **HOW, engine=engine) for engine in ("cuda", "native"))
    assert done.fault.kind.tolist() == [1, 0, 1]
    assert_same(done, expected)


@pytest.mark.full
@needs_gxx
def test_a_scenario_file_can_select_the_cuda_engine(card):
    changes = {"simulation.t1": 0.02}
    starts = jnp.array([[0.2, 0.8], [0.21, 0.79], [0.19, 0.8], [0.2, 0.81], [0.2, 0.78]])
    on_card, on_processor = (
        scenarios.load("example-4.1-1khz", {**changes, "simulation.engine": engine}).simulate_batch(
            lambda loop, q: loop.replace(state0=State(q, jnp.zeros(2))), starts
        )
        for engine in ("cuda", "native")
    )
    assert len(card) == 1
    assert_same(on_card, on_processor)


def test_a_single_run_with_the_cuda_engine_uses_the_cpu_with_a_warning():
    with pytest.warns(UserWarning, match="with the engine `native`, because `cuda` is for batches"):
        run = simulate(plant_4_1(), SPRING, MOTION_4_1, START_4_1, t1=0.01, period=1e-3, engine="cuda")
    assert_same(run.tally, simulate(plant_4_1(), SPRING, MOTION_4_1, START_4_1, t1=0.01, period=1e-3).tally)


def test_a_batch_without_a_gpu_is_refused_with_the_missing_requirement():
    if cuda.card_available():
        pytest.skip("there is a card")
    with pytest.raises(DefinitionError, match=r"slidax\[cuda\]|driver|no NVIDIA GPU"):
        simulate_batch(shifted, VARIED, t1=0.1, period=1e-3, engine="cuda")


def test_a_batch_on_a_gpu_has_the_bits_of_the_native_engine():
    if not cuda.card_available():
        pytest.skip("CuPy or a card is missing")
    on_card, on_processor = (simulate_batch(shifted, VARIED, **LOGGED, engine=engine) for engine in ("cuda", "native"))
    assert_same(on_card, on_processor)
