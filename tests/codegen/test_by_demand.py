from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from slidax import State, scenarios
from slidax.codegen import llvm
from slidax.codegen.builder import Builder
from slidax.codegen.ir import ELEMENTARY
from slidax.codegen.llvm import kernel, machine
from slidax.codegen.llvm import kernel as by_demand
from slidax.codegen.llvm import machine as cache
from slidax.simulation import native_engine

from .test_llvm import scaled


@pytest.fixture(autouse=True)
def empty_folder(monkeypatch, tmp_path):
    monkeypatch.setattr(cache, "folder", lambda: tmp_path / "native")


@pytest.fixture
def levels(monkeypatch):
    """LLVM's level of each module that is compiled."""
    seen = []
    monkeypatch.setattr(machine, "OPTIMISED", 2)
    compiled = machine.Machine.compiled

    def noted(self, text, level):
        seen.append(level)
        return compiled(self, text, level)

    monkeypatch.setattr(machine.Machine, "compiled", noted)
    return seen


def test_code_is_made_well_once_it_was_asked_for_enough_turns(levels):
    code = llvm.ByDemand(scaled())
    first = code.kernel(by_demand.WORTHWHILE_TURNS[1] // 2)
    assert first.quick and code.kernel(1) is first
    later = code.kernel(by_demand.WORTHWHILE_TURNS[1] // 2)
    assert not later.quick and code.kernel(1) is later
    assert levels == [machine.QUICK, machine.OPTIMISED]


@pytest.mark.parametrize("lanes", [1, 8])
def test_one_long_run_gets_good_code_at_once(levels, lanes):
    assert not llvm.ByDemand(scaled(), lanes).kernel(by_demand.WORTHWHILE_TURNS[lanes]).quick
    assert levels == [machine.OPTIMISED]


def test_good_code_of_another_time_is_taken(levels):
    llvm.compile(scaled())
    assert not llvm.ByDemand(scaled()).kernel(1).quick
    assert levels == [machine.OPTIMISED]


def test_a_folder_that_may_not_be_looked_into_stops_nobody(levels, monkeypatch, tmp_path):
    # Another user's folder, as in a container: a name that is too long is refused to root as well.
    monkeypatch.setattr(cache, "folder", lambda: tmp_path / ("a" * 300))
    assert llvm.ByDemand(scaled()).kernel(1).quick


def test_a_program_whose_values_might_fill_a_threads_stack_is_made_well(levels, monkeypatch):
    monkeypatch.setattr(by_demand, "STACK_LIMIT", 8)
    assert not llvm.ByDemand(scaled()).kernel(1).quick


def test_the_stack_that_quick_code_takes_is_less_than_what_its_values_are_counted_for():
    scenario = scenarios.load("example-4.1-1khz")
    programs = []
    made = kernel.Kernel.__init__

    def noted(self, program, lanes, **how):
        programs.append(program)
        made(self, program, lanes, **how)

    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(kernel.Kernel, "__init__", noted)
        native_engine._compiled.cache_clear()
        scenario.simulate()
    largest = max(programs, key=lambda program: sum(1 for _ in program.walk()))
    counted = sum(1 for _ in largest.walk()) * by_demand.VALUE_SIZE
    assert 0 < frame_of(kernel.Kernel(largest, 1, quick=True).object) < counted


def frame_of(code: bytes) -> int:
    """Bytes by which the stack grows at once: `sub rsp, number` of x86-64."""
    at = code.find(b"\x48\x81\xec")
    if at < 0:
        pytest.skip("not the code of an x86-64")
    return int.from_bytes(code[at + 3 : at + 7], "little")


@pytest.mark.parametrize("lanes", [1, 8])
@pytest.mark.parametrize("kind", ["f64", "f32"])
@pytest.mark.parametrize("op", ELEMENTARY)
def test_a_function_that_is_called_gives_the_bits_of_the_one_that_is_written_out(op, kind, lanes):
    b = Builder()
    given = [b.input(f"x{k}", kind, (), varying=True).item() for k in range(2 if op in ("pow", "atan2") else 1)]
    value = b.apply(op, *given, type=kind)
    # With a sum around it, into which a product would be taken.
    b.output("y", kind, np.array([value, b.apply("add", value, given[0], type=kind)], object))
    program = b.finish()
    numbers = np.random.default_rng(0).normal(size=(len(given), 200)) * np.exp(np.linspace(-20.0, 8.0, 200))
    edges = np.array([0.0, -0.0, np.inf, -np.inf, np.nan, 1e300, -1e300, 5e-324])
    with np.errstate(over="ignore"):
        spread = [np.concatenate([row, edges]).astype(np.float64 if kind == "f64" else np.float32) for row in numbers]
    (quick,) = kernel.Kernel(program, lanes, quick=True).batch(spread, len(spread[0]))
    (well,) = kernel.Kernel(program, lanes).batch(spread, len(spread[0]))
    np.testing.assert_array_equal(quick, well)
    there = ~np.isnan(well)
    np.testing.assert_array_equal(np.signbit(quick[there]), np.signbit(well[there]))


def test_a_run_has_the_same_bits_by_both(monkeypatch):
    scenario = scenarios.load("example-4.1-1khz")
    quick = scenario.simulate(log_every=1)
    monkeypatch.setitem(by_demand.WORTHWHILE_TURNS, 1, 0)
    well = scenario.simulate(log_every=1)
    for one, other in zip(jax.tree.leaves(quick.log), jax.tree.leaves(well.log), strict=True):
        np.testing.assert_array_equal(one, other)


def test_a_batch_has_the_same_bits_by_both(monkeypatch):
    scenario = scenarios.load("example-4.1-1khz")

    def runs():
        return scenario.simulate_batch(
            lambda one, q: one.replace(state0=State(q)), scenario.state0.q + jnp.array([[0.0], [1e-3]])
        ).tally

    quick = runs()
    monkeypatch.setitem(by_demand.WORTHWHILE_TURNS, 8, 0)
    for one, other in zip(jax.tree.leaves(quick), jax.tree.leaves(runs()), strict=True):
        np.testing.assert_array_equal(one, other)
