from __future__ import annotations

import platform

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from slidax import State, scenarios
from slidax.codegen import llvm
from slidax.codegen.builder import Builder
from slidax.codegen.ir import ELEMENTARY
from slidax.codegen.llvm import kernel, machine
from slidax.simulation import native_engine

from .test_llvm import scaled

pytestmark = pytest.mark.usefixtures("folder")


@pytest.fixture
def levels(monkeypatch):
    """LLVM's optimisation level of each compiled module."""
    levels, compiled = [], machine.Machine.compiled
    monkeypatch.setattr(machine, "OPTIMISED", 2)
    monkeypatch.setattr(
        machine.Machine, "compiled", lambda self, text, level: levels.append(level) or compiled(self, text, level)
    )
    return levels


def test_code_is_optimised_after_enough_iterations(levels):
    code = llvm.ByDemand(scaled())
    first = code.kernel(kernel.WORTHWHILE_ITERATIONS[1] // 2)
    assert first.quick and code.kernel(1) is first
    later = code.kernel(kernel.WORTHWHILE_ITERATIONS[1] // 2)
    assert not later.quick and code.kernel(1) is later
    assert levels == [machine.QUICK, machine.OPTIMISED]


@pytest.mark.parametrize("lanes", [1, 8])
def test_a_long_run_gets_optimised_code_at_once(levels, lanes):
    assert not llvm.ByDemand(scaled(), lanes).kernel(kernel.WORTHWHILE_ITERATIONS[lanes]).quick
    assert levels == [machine.OPTIMISED]


def test_cached_optimised_code_is_used(levels):
    llvm.compile(scaled())
    assert not llvm.ByDemand(scaled()).kernel(1).quick
    assert levels == [machine.OPTIMISED]


def test_an_inaccessible_cache_folder_does_not_stop_a_run(levels, monkeypatch, tmp_path):
    # Stands for another user's folder, as in a container: a name that is too long fails for root, too.
    monkeypatch.setattr(machine, "folder", lambda: tmp_path / ("a" * 300))
    assert llvm.ByDemand(scaled()).kernel(1).quick


def test_program_too_large_for_a_threads_stack_gets_optimised_code(levels, monkeypatch):
    monkeypatch.setattr(kernel, "STACK_LIMIT", 8)
    assert not llvm.ByDemand(scaled()).kernel(1).quick


@pytest.mark.skipif(platform.machine() != "x86_64", reason="the stack size is read from x86-64 code")
def test_stack_of_unoptimised_code_is_below_its_estimate(monkeypatch):
    programs, init = [], kernel.Kernel.__init__

    def noted(self, program, lanes, **how):
        programs.append(program)
        init(self, program, lanes, **how)

    monkeypatch.setattr(kernel.Kernel, "__init__", noted)
    native_engine._compiled.cache_clear()
    scenarios.load("example-4.1-1khz").simulate()
    monkeypatch.undo()
    largest = max(programs, key=lambda program: sum(1 for _ in program.walk()))
    counted = sum(1 for _ in largest.walk()) * kernel.VALUE_SIZE
    code = kernel.Kernel(largest, 1, quick=True).object
    # Bytes by which the stack grows at once: `sub rsp, number` of x86-64.
    at = code.find(b"\x48\x81\xec")
    assert at >= 0
    assert 0 < int.from_bytes(code[at + 3 : at + 7], "little") < counted


@pytest.mark.parametrize("lanes", [1, 8])
@pytest.mark.parametrize("kind", ["f64", "f32"])
@pytest.mark.parametrize("op", ELEMENTARY)
def test_called_elementary_function_gives_the_same_bits_as_its_inlined_expansion(op, kind, lanes):
    b = Builder()
    inputs = [b.input(f"x{k}", kind, (), varying=True).item() for k in range(2 if op in ("pow", "atan2") else 1)]
    value = b.apply(op, *inputs, type=kind)
    # A sum follows, into which a product would be fused.
    b.output("y", kind, np.array([value, b.apply("add", value, inputs[0], type=kind)], object))
    program = b.finish()
    numbers = np.random.default_rng(0).normal(size=(len(inputs), 200)) * np.exp(np.linspace(-20.0, 8.0, 200))
    edges = np.array([0.0, -0.0, np.inf, -np.inf, np.nan, 1e300, -1e300, 5e-324])
    with np.errstate(over="ignore"):
        spread = [np.concatenate([row, edges]).astype(np.float64 if kind == "f64" else np.float32) for row in numbers]
    (quick,) = kernel.Kernel(program, lanes, quick=True).batch(spread, len(spread[0]))
    (well,) = kernel.Kernel(program, lanes).batch(spread, len(spread[0]))
    np.testing.assert_array_equal(quick, well)
    there = ~np.isnan(well)
    np.testing.assert_array_equal(np.signbit(quick[there]), np.signbit(well[there]))


@pytest.mark.parametrize("lanes", [1, 8])
def test_unoptimised_and_optimised_code_give_bit_identical_runs(monkeypatch, lanes):
    scenario = scenarios.load("example-4.1-1khz")
    starts = scenario.state0.q + jnp.array([[0.0], [1e-3]])

    def leaves():
        if lanes == 1:
            return jax.tree.leaves(scenario.simulate(log_every=1).log)
        return jax.tree.leaves(scenario.simulate_batch(lambda loop, q: loop.replace(state0=State(q)), starts).tally)

    quick = leaves()
    monkeypatch.setitem(kernel.WORTHWHILE_ITERATIONS, lanes, 0)
    for ours, theirs in zip(quick, leaves(), strict=True):
        np.testing.assert_array_equal(ours, theirs)
