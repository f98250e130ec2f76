from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from slidax.codegen import llvm
from slidax.codegen.builder import Builder
from slidax.codegen.ir import DTYPES, Branch
from slidax.codegen.llvm import machine
from slidax.codegen.llvm.blocks import varying_values
from slidax.codegen.llvm.machine import host
from slidax.codegen.llvm.vectorise import lower_and_fuse
from slidax.core.errors import DefinitionError

from .interpreter import interpreted
from .random_programs import RandomProgram, random_arrays

RUNS = 11  # no multiple of any number of lanes
LANES = (1, 4, 8)
pytestmark = pytest.mark.usefixtures("folder")


def bits(arrays):
    return [array.tobytes() for array in arrays]


def per_run(make, type, *arrays, lanes):
    """`make(b, x, y, ...)`, a value of `type`, for each element of the arrays, as a batch."""
    b = Builder()
    inputs = [b.input(f"x{k}", _type(array), (), varying=True).item() for k, array in enumerate(arrays)]
    b.output("y", type, np.array(make(b, *inputs), object))
    return llvm.compile(b.finish(), lanes).batch(arrays, len(arrays[0]))[0]


def _type(array):
    return next(name for name, dtype in DTYPES.items() if np.dtype(dtype) == array.dtype)


@pytest.mark.parametrize("seed", range(8))
def test_random_programs_have_the_interpreters_bits_for_any_number_of_lanes(seed):
    program = RandomProgram(seed, size=16).finish()
    chance = np.random.default_rng(seed)
    varies = [bool(chance.integers(2)) for _ in program.inputs]
    program.inputs[:] = [dataclasses.replace(i, varying=v) for i, v in zip(program.inputs, varies, strict=True)]
    runs = [random_arrays(100 * seed + k) for k in range(RUNS)]
    arrays = [np.stack(column) if v else column[0] for column, v in zip(zip(*runs, strict=True), varies, strict=True)]
    spread = [x if v else np.stack([x] * RUNS) for x, v in zip(arrays, varies, strict=True)]
    expected = bits(interpreted(lower_and_fuse(program), *spread))
    for lanes in LANES:
        assert bits(llvm.compile(program, lanes).batch(arrays, RUNS)) == expected


@pytest.mark.parametrize("level", [0, 1])
def test_results_have_the_same_bits_at_every_optimisation_level(monkeypatch, level):
    """Daily tests compile at level 0, where LLVM is three times as fast."""
    monkeypatch.setattr(machine, "OPTIMISED", level)
    host.cache_clear()
    for seed in (0, 1):
        program = RandomProgram(seed, size=16).finish()
        arrays = random_arrays(100 * seed)
        expected = bits(interpreted(lower_and_fuse(program), *(x[None] for x in arrays)))
        for lanes in LANES:
            assert bits(array[None] for array in llvm.compile(program, lanes)(arrays)) == expected


NAN, INF = float("nan"), float("inf")


@pytest.mark.parametrize("type", ["f64", "f32"])
@pytest.mark.parametrize("lanes", LANES)
def test_minimum_and_maximum_with_nan_are_nan(lanes, type):
    x, y = np.array([[1.0, 2.0], [NAN, 2.0], [1.0, NAN], [3.0, 2.0], [-INF, NAN]], DTYPES[type]).T.copy()
    for op, compute in (("min", np.minimum), ("max", np.maximum)):
        done = per_run(lambda b, x, y, op=op: b.apply(op, x, y), type, x, y, lanes=lanes)
        np.testing.assert_array_equal(done, compute(x, y))
        with_constant = per_run(lambda b, x, op=op: b.apply(op, x, b.constant(1.5, type)), type, x, lanes=lanes)
        np.testing.assert_array_equal(with_constant, compute(x, np.asarray(1.5, x.dtype)))


@pytest.mark.parametrize("lanes", LANES)
def test_a_float_is_rounded_towards_zero_and_saturates_as_integer(lanes):
    x = np.array([1.9, -1.9, 1e300, -1e300, NAN, INF, -INF, 2.0**31, -0.5])
    for type in ("i64", "i32", "u32"):
        ends = np.iinfo(DTYPES[type])
        exact = [
            0 if math.isnan(v) else max(ends.min, min(ends.max, math.trunc(v) if math.isfinite(v) else v)) for v in x
        ]
        exact = [ends.max if v == INF else ends.min if v == -INF else v for v in exact]
        done = per_run(lambda b, x, type=type: b.apply("convert", x, type=type), type, x, lanes=lanes)
        assert done.tolist() == exact


@pytest.mark.parametrize("lanes", LANES)
def test_integer_division_by_zero_and_overflow_is_defined(lanes):
    least = np.iinfo(np.int64).min
    x, y = np.array([[7, 2], [-7, 2], [7, 0], [least, -1], [least, 0], [5, -3]], np.int64).T.copy()
    quotient = per_run(lambda b, x, y: b.apply("div", x, y), "i64", x, y, lanes=lanes)
    rest = per_run(lambda b, x, y: b.apply("rem", x, y), "i64", x, y, lanes=lanes)
    assert quotient.tolist() == [3, -3, -1, least, -1, -1]
    assert rest.tolist() == [1, -1, 7, 0, least, 2]


@pytest.mark.parametrize("lanes", LANES)
def test_shift_by_the_word_length_leaves_zero_or_the_sign(lanes):
    x, by = np.array([[5, 1], [-5, 1], [5, 32], [-5, 31], [-5, 40]], np.int32).T.copy()
    done = [
        per_run(lambda b, x, y, op=op: b.apply(op, x, y, type="i32"), "i32", x, by, lanes=lanes).tolist()
        for op in ("shl", "shr", "sar")
    ]
    assert done == [[10, -10, 0, -(2**31), 0], [2, 2**31 - 3, 0, 1, 0], [2, -3, 0, -1, -1]]


@pytest.mark.parametrize("type", ["f64", "f32"])
def test_elementary_functions_agree_with_the_c_library_in_both_precisions(type):
    x = np.linspace(-0.9, 0.9, RUNS).astype(DTYPES[type])
    for op in ("tan", "tanh", "erf", "asin"):
        many, single = (per_run(lambda b, x, op=op: b.apply(op, x), type, x, lanes=lanes) for lanes in (8, 1))
        assert many.tobytes() == single.tobytes()
        np.testing.assert_allclose(single, [getattr(math, op)(v) for v in x], rtol=4 * np.finfo(x.dtype).eps)


@pytest.mark.parametrize("lanes", LANES)
def test_booleans_are_bytes_in_inputs_and_outputs(lanes):
    x, y = np.array([[True, True], [True, False], [False, True], [False, False]] * 3).T.copy()
    done = per_run(lambda b, x, y: b.apply("and", x, b.apply("not", y)), "b1", x, y, lanes=lanes)
    assert done.dtype == np.bool_ and done.tolist() == (x & ~y).tolist()


def loop_over_time(b, count, body, *start):
    """`body(k, t, ...)` for k = 0, ..., count - 1, with t = k / 8."""
    zero, unit, last = (b.constant(k, "i64") for k in (0, 1, count))

    def turn(carried):
        k = carried[0]
        t = b.apply("mul", b.apply("convert", k, type="f64"), b.constant(0.125, "f64"))
        return [b.apply("add", k, unit), *body(k, t, *carried[1:])]

    return b.loop([zero, *start], lambda carried: b.apply("lt", carried[0], last), turn, last)[1:]


def test_values_that_depend_on_time_only_are_computed_once_for_all_runs():
    b = Builder()
    gain, speed = b.input("gain", "f64", (), varying=True).item(), b.input("speed", "f64", ()).item()
    wave = []

    def turn(k, t, y, phase):
        wave.append(b.apply("sqrt", b.apply("mul", t, phase)))
        return [b.apply("add", y, b.apply("mul", gain, wave[0])), b.apply("add", phase, speed)]

    y, phase = loop_over_time(b, 5, turn, gain, b.constant(0.0, "f64"))
    b.output("y", "f64", np.array([y, phase], object))
    program = b.finish()
    differing = varying_values(program)
    assert y in differing and gain in differing
    assert not differing & {phase, speed, wave[0]}
    text = llvm.compile(program, 8).text
    assert "call double @llvm.sqrt.f64" in text and "llvm.sqrt.v8f64" not in text


def test_runs_that_leave_a_loop_early_keep_their_values():
    b = Builder()
    limit = b.input("limit", "f64", (), varying=True).item()
    unit = b.constant(1.0, "f64")
    # The second number doubles in all runs, but not equally often.
    total, power = b.loop(
        [b.constant(0.0, "f64"), unit],
        lambda carried: b.apply("lt", carried[0], limit),
        lambda carried: [b.apply("add", carried[0], unit), b.apply("add", carried[1], carried[1])],
    )
    b.output("y", "f64", np.array([total, power], object))
    program = b.finish()
    assert power in varying_values(program)
    limits = np.array([3.0, 0.0, -1.0, NAN, 7.0, 1.0, 2.5, 9.0, 4.0, 5.0, 6.0])
    turns = np.ceil(np.where(limits > 0, limits, 0.0))
    for lanes in LANES:
        (y,) = llvm.compile(program, lanes).batch([limits], RUNS)
        np.testing.assert_array_equal(y, np.stack([turns, 2.0**turns], axis=1))


def test_a_side_of_a_branch_that_no_run_takes_is_skipped():
    b = Builder()
    x = b.input("x", "f64", (), varying=True).item()
    table = b.input("table", "f64", (4,))
    at = b.input("at", "i64", (), varying=True).item()
    inside = b.apply("lt", at, b.constant(4, "i64"))
    (y,) = b.branch(inside, lambda: [b.apply("load", at, type="f64", data=1)], lambda: [b.apply("sqrt", x)])
    del table
    b.output("y", "f64", np.array(y, object))
    program = b.finish()
    assert any(isinstance(value, Branch) for value in program.walk())
    numbers, table = np.arange(RUNS) ** 2.0, np.array([10.0, 11.0, 12.0, 13.0])
    # Runs that do not read the table have an index far outside it.
    for places in (np.arange(RUNS) % 4, np.full(RUNS, 2**40), np.where(np.arange(RUNS) % 2, 2, 2**40)):
        expected = np.where(places < 4, table[places % 4], np.sqrt(numbers))
        for lanes in LANES:
            (y,) = llvm.compile(program, lanes).batch([numbers, table, places], RUNS)
            assert y.tolist() == expected.tolist()


@pytest.mark.parametrize("size", [1, 3, 8, 21])
def test_each_run_logs_its_own_rows(size):
    b = Builder()
    x = b.input("x", "f64", (size,), varying=True)
    every = b.input("every", "i64", (), varying=True).item()
    log, marks = b.logged("log", "f64", (size,)), b.logged("marks", "b1", (2,))
    certain = b.constant(True, "b1")

    def turn(k, t):
        when = b.apply("eq", b.apply("rem", k, every), b.constant(0, "i64"))
        row = b.apply("div", k, every)
        b.store(log, row, when, np.array([b.apply("add", element, t) for element in x], object))
        b.store(marks, k, certain, np.array([when, certain], object))
        return []

    loop_over_time(b, 6, turn)
    program = b.finish()
    numbers, strides = np.random.default_rng(size).normal(size=(RUNS, size)), np.arange(RUNS) % 3 + 1
    expected, marked = np.zeros((RUNS, 6, size)), np.zeros((RUNS, 6, 2), bool)
    for run, stride in enumerate(strides):
        expected[run, : len(range(0, 6, stride))] = numbers[run] + np.arange(0, 6, stride)[:, None] / 8
        marked[run] = [[k % stride == 0, True] for k in range(6)]
    for lanes in LANES:
        rows, kept = llvm.compile(program, lanes).batch([numbers, strides], RUNS, rows=6)
        np.testing.assert_array_equal(rows, expected)
        np.testing.assert_array_equal(kept, marked)


def scaled():
    """`scale x` for two numbers; only x differs between runs."""
    b = Builder()
    x, scale = b.input("x", "f64", (2,), varying=True), b.input("scale", "f64", ()).item()
    b.output("y", "f64", np.array([b.apply("mul", element, scale) for element in x], object))
    return b.finish()


@pytest.mark.parametrize("lanes", LANES)
def test_single_run_takes_and_returns_arrays_without_a_batch_axis(lanes):
    (y,) = llvm.compile(scaled(), lanes)([np.array([1.0, 2.0]), np.array(3.0)])
    assert y.shape == (2,) and y.tolist() == [3.0, 6.0]


@pytest.mark.parametrize("lanes", LANES)
@pytest.mark.parametrize("runs", [1, 7, 8, 200])
def test_a_batch_does_not_depend_on_threads_or_group_size(runs, lanes):
    x = np.random.default_rng(runs).normal(size=(2, runs)).T  # not contiguous
    kernel = llvm.compile(scaled(), lanes)
    for threads in (1, 3, None):
        (y,) = kernel.batch([x, np.array(3.0)], runs, threads=threads)
        np.testing.assert_array_equal(y, 3.0 * x)


def test_arrays_of_wrong_shape_or_type_are_refused_by_name():
    kernel = llvm.compile(scaled())
    with pytest.raises(DefinitionError, match=r"`x` must be float64 of shape \[2\]; got float64 of shape \[3\]"):
        kernel([np.zeros(3), np.array(1.0)])
    with pytest.raises(DefinitionError, match=r"`scale` must be float64 of shape \[\]; got int64 of shape \[\]"):
        kernel([np.zeros(2), np.array(1)])
    with pytest.raises(DefinitionError, match=r"`x` must be float64 of shape \[5, 2\]; got float64 of shape \[4, 2\]"):
        kernel.batch([np.zeros((4, 2)), np.array(1.0)], 5)


@pytest.mark.parametrize("lanes", [1, 8])
@pytest.mark.parametrize("inputs", [[], [np.zeros(2)]])
def test_a_wrong_number_of_inputs_is_refused(lanes, inputs):
    with pytest.raises(DefinitionError, match=f"2 inputs; got {len(inputs)}"):
        llvm.compile(scaled(), lanes)(inputs)


def test_a_number_of_lanes_that_is_no_power_of_two_is_refused():
    with pytest.raises(DefinitionError, match="power of two"):
        llvm.compile(scaled(), 3)
