"""The closed loop and its derivatives as a program in slidax's intermediate representation."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import equinox as eqx
import jax
import numpy as np

from slidax.codegen.builder import Builder, Values
from slidax.codegen.ir import Program, Value, as_native_code_error
from slidax.codegen.trace.arrays import constant_array, full_array, pack, unpack
from slidax.codegen.trace.tracing import inline, ir_type, located_tracing_errors, named_leaves
from slidax.core.types import State

from .loop import Carry, ClosedLoop, begin, sample
from .outcome import Fault

Define = Callable[[Any], tuple[ClosedLoop, State]]
"""Function that maps arrays to a loop and the state at t = 0."""


@dataclass(frozen=True)
class NativeLoop:
    """A closed loop as a program, with the shapes of its results.

    Inputs of the program, in this order:
    - `consts`, and the loop's arrays.
    - `steps`: the number of samples to advance.
    - `every`, only with a log: every `every`-th sample is logged.
    - `fresh`, only for a single run: True to start at t = 0.
    - A `Carry`, only for a single run: the loop's state from which the run continues if not `fresh`.

    The program's outputs are the log's arrays, row by row, and a `LoopStart`, whose `Carry` is the one after the last
    sample.

    - `consts`: constant arrays in the loop's functions.
    - `start`: the `LoopStart`, with shapes instead of arrays.
    - `log`: log of one sample, with shapes instead of arrays; None without a log.
    """

    program: Program
    consts: tuple[np.ndarray, ...]
    start: Any
    log: Any


def single_loop(define: Define, arrays: Any, *, logged: bool) -> NativeLoop:
    """Return the program of one run, which ends at a fault or after `steps` samples (an input of the program).

    - `define`: maps arrays to a loop and the state at t = 0.
    - `arrays`: shapes of these arrays.
    - `logged`: True to log every `every`-th sample.
    """
    return lower_loop(*_parts(define), arrays, logged=logged, batch=False)


def batch_loop(define: Define, arrays: Any, *, logged: bool) -> NativeLoop:
    """Return the program of a batch; a run that has ended keeps its state until all runs have ended.

    - `define`, `arrays`, `logged`: as in `single_loop`, with the shapes of one run's arrays.
    """
    return lower_loop(*_parts(define), arrays, logged=logged, batch=True)


def _parts(define: Define) -> tuple[Callable[..., Any], Callable[..., Any]]:
    return (lambda arrays: begin(*define(arrays))), (lambda arrays, carry: sample(define(arrays)[0], carry))


def lower_loop(
    start: Callable[..., Any],
    step: Callable[..., Any],
    arrays: Any,
    *,
    logged: bool,
    batch: bool,
    shared: Any = None,
    beforehand: Callable[[Any], Any] | None = None,
) -> NativeLoop:
    """Translate a loop, given as the functions `start` and `step`, to a program.

    - `start`: maps a run's arrays to a `LoopStart`.
    - `step`: maps a run's arrays and a carry to the next carry and one row of the log.
    - `arrays`: shapes of one run's arrays.
    - `logged`: True to log every `every`-th sample.
    - `batch`: True for many runs in parallel.
    - `shared`: arrays that all runs of a batch share; then each function takes `(shared, arrays)` for `arrays`.
    - `beforehand`: preprocessing of the arrays, done once before the first sample; `start` and `step` take its result.

    Raises NoNativeCodeError if an operation of the loop has no machine code.
    """
    inputs = arrays if shared is None else (shared, arrays)
    before = None if beforehand is None else _Traced(beforehand, inputs)
    values = inputs if before is None else before.result
    traced_start = _Traced(start, values)
    traced_step = _Traced(step, values, traced_start.result[0])
    # Errors in the lines above would also occur with XLA, so they keep their own type.
    with as_native_code_error(lambda: "the loop"):
        return _program(before, traced_start, traced_step, inputs, logged, batch, len(jax.tree.leaves(shared)))


def _program(
    before: _Traced | None,
    start: _Traced,
    step: _Traced,
    arrays: Any,
    logged: bool,
    batch: bool,
    shared: int,
) -> NativeLoop:
    b = Builder()
    captured = _Captured(b)
    of_before = [] if before is None else captured.inputs(before.jaxpr.consts)
    of_start, of_step = captured.inputs(start.jaxpr.consts), captured.inputs(step.jaxpr.consts)
    values = [
        b.input(name, ir_type(leaf.dtype, name), leaf.shape, varying=batch and index >= shared)
        for index, (name, leaf) in enumerate(named_leaves((jax.tree.map(_shape, arrays),), ("",)))
    ]
    if before is not None:
        b.origin = BEFOREHAND
        values = [
            _as_input(b, k, array) for k, array in enumerate(inline(b, before.jaxpr, values, constants=of_before))
        ]
        b.origin = None
    steps = b.input("steps", "i64", ()).item()
    every = b.input("every", "i64", ()).item() if logged else None
    rows = [
        (b.logged(name, ir_type(leaf.dtype, name), leaf.shape) if logged else 0)
        for name, leaf in named_leaves((step.result[1],), ("log",))
    ]
    carried = len(jax.tree.leaves(start.result[0]))
    first = _start(b, start, lambda: inline(b, start.jaxpr, values, constants=of_start), carried, batch)
    fault = _index_of_fault(start.result[0])
    shapes = [array.shape for array in first[:carried]]
    zero, unit = b.constant(0, "i64"), b.constant(1, "i64")

    def unfinished(numbers: Sequence[Value]) -> Value:
        more = b.apply("lt", numbers[0], steps)
        if batch:
            return more
        kind = unpack(numbers[3:], shapes)[fault].item()
        return b.apply("and", more, b.apply("eq", kind, b.constant(0, kind.type)))

    def following(numbers: Sequence[Value]) -> list[Value]:
        count, left, row = numbers[:3]
        results = inline(b, step.jaxpr, [*values, *unpack(numbers[3:], shapes)], constants=of_step)
        if every is not None:
            due = b.apply("eq", left, zero)
            for output, line in zip(rows, results[carried:], strict=True):
                b.store(output, row, due, line)
            left = b.apply("sub", b.apply("select", due, every, left), unit)
            row = b.apply("add", row, b.apply("convert", due, type="i64"))
        return [b.apply("add", count, unit), left, row, *pack(results[:carried])]

    ended = b.loop([zero, zero, zero, *pack(first[:carried])], unfinished, following, steps if batch else None)
    results = [*unpack(ended[3:], shapes), *first[carried:]]
    for (name, leaf), array in zip(named_leaves((start.result,), ("",)), results, strict=True):
        b.output(name, ir_type(leaf.dtype, name), array)
    return NativeLoop(b.finish(), tuple(captured.arrays), start.result, step.result[1] if logged else None)


def _start(b: Builder, start: _Traced, compute: Callable[[], list[Values]], carried: int, batch: bool) -> list[Values]:
    """Return the arrays of a `LoopStart`: computed if `fresh`, else the input carry and zeros for the rest."""
    if batch:
        return compute()
    fresh = b.input("fresh", "b1", ()).item()
    named = named_leaves((start.result,), ("",))
    carry = [b.input(name, ir_type(leaf.dtype, name), leaf.shape) for name, leaf in named[:carried]]
    zeros = [full_array(b.constant(0, ir_type(leaf.dtype, name)), leaf.shape) for name, leaf in named[carried:]]
    values = b.branch(fresh, lambda: pack(compute()), lambda: pack([*carry, *zeros]))
    return unpack(values, [array.shape for array in (*carry, *zeros)])


BEFOREHAND = "beforehand"
"""Origin label of values that are computed before the first sample."""


def _as_input(b: Builder, which: int, array: Values) -> Values:
    """Return copies of values, which optimisation treats as inputs, so that the loop rounds as it does with inputs."""
    copies = np.empty(array.size, object)
    for k, value in enumerate(array.ravel()):
        copies[k] = b.apply("copy", value, type=value.type, data=(which, k))
    return copies.reshape(array.shape)


class _Traced:
    """A function's jaxpr, and its result with shapes instead of arrays."""

    def __init__(self, function: Callable[..., Any], *args: Any) -> None:
        rest: list[Any] = []

        def arrays_of(*args: Any) -> Any:
            arrays, static = eqx.partition(function(*args), eqx.is_array)
            rest[:] = [static]
            return arrays

        shapes = jax.tree.map(_shape, args)
        with located_tracing_errors():
            self.jaxpr, arrays = jax.make_jaxpr(arrays_of, return_shape=True)(*shapes)
        self.result = eqx.combine(arrays, rest[0], is_leaf=lambda x: x is None)


class _Captured:
    """Arrays that functions close over; each becomes one input."""

    def __init__(self, builder: Builder) -> None:
        self.builder = builder
        self.arrays: list[np.ndarray] = []
        self._known: dict[int, Values] = {}

    def inputs(self, consts: Sequence[Any]) -> list[Values]:
        values = []
        for const in consts:
            # Masks and indices stay constants, so that masked values are not computed.
            if not isinstance(const, jax.Array) and np.asarray(const).dtype.kind in "bi":
                values.append(constant_array(self.builder, np.asarray(const)))
                continue
            if id(const) not in self._known:
                name = f"const{len(self.arrays)}"
                self._known[id(const)] = self.builder.input(name, ir_type(const.dtype, name), np.shape(const))
                self.arrays.append(np.asarray(const))
            values.append(self._known[id(const)])
        return values


def _index_of_fault(carry: Any) -> int:
    """Return the index of `fault.kind` among the carry's arrays."""
    marked = eqx.tree_at(lambda c: c.fault.kind, carry, None, is_leaf=lambda x: x is None)
    before = [name for name, _ in named_leaves((carry,), ("",))]
    (missing,) = set(before) - {name for name, _ in named_leaves((marked,), ("",))}
    return before.index(missing)


def _shape(x: Any) -> jax.ShapeDtypeStruct:
    return jax.ShapeDtypeStruct(np.shape(x), x.dtype)


class Dual(eqx.Module):
    """A pytree `value` and its directional derivative `tangent`, which has None for leaves that are not floating-point.

    `tangent` has the structure of `value`.
    """

    value: Any
    tangent: Any

    @property
    def fault(self) -> Fault:
        return self.value.fault


def duals(define: Callable[[Any], tuple[ClosedLoop, State]]) -> tuple[Callable[..., Any], Callable[..., Any]]:
    """Return `begin` and `sample` of a loop with forward-mode derivatives, as functions of a pair `(at, direction)`.

    - The first maps the pair to a `LoopStart` whose carry is a `Dual`.
    - The second maps the pair and this carry to the next carry and the sample's log, both `Dual`s.

    - `define`: maps the arrays `at` to a loop and the state at t = 0.
    """

    def begin_dual(point: tuple[Any, Any]) -> tuple[Dual, Any, Any, Any]:
        (carry, *rest), (tangent, *_) = jvp(lambda at: begin(*define(at)), *point)
        return Dual(carry, tangent), *rest

    def sample_dual(point: tuple[Any, Any], carry: Dual) -> tuple[Dual, Dual]:
        def step(at_and_carry: tuple[Any, Carry]) -> Any:
            at, before = at_and_carry
            return sample(define(at)[0], before)

        at, direction = point
        values, tangents = jvp(step, (at, carry.value), (direction, carry.tangent))
        after, log = (Dual(value, tangent) for value, tangent in zip(values, tangents, strict=True))
        return after, log

    return begin_dual, sample_dual


def jvp(function: Callable[[Any], Any], at: Any, direction: Any) -> tuple[Any, Any]:
    """Return `f(x)` and `f'(x) v` for a function f of one tree, of which only floating-point arrays have derivatives.

    - `at`, `direction`: the trees x and v; v has None where x has no floating-point array.
    """
    floats, rest = eqx.partition(at, eqx.is_inexact_array)
    leaves, tree = jax.tree.flatten(floats)
    static: list[Any] = []

    def of_floats(*leaves: Any) -> Any:
        result = function(eqx.combine(jax.tree.unflatten(tree, leaves), rest))
        smooth, others = eqx.partition(result, eqx.is_inexact_array)
        arrays, left = eqx.partition(others, eqx.is_array)
        static[:] = [left]
        return smooth, arrays

    values, tangents, arrays = jax.jvp(of_floats, leaves, jax.tree.leaves(direction), has_aux=True)
    return eqx.combine(values, arrays, static[0]), tangents


@dataclass(frozen=True)
class LoopSignature:
    """Key of compiled code: loops with equal signatures share the code."""

    tree: Any
    shapes: tuple[tuple[tuple[int, ...], str], ...]
    static_tree: Any
    static: tuple[Any, ...]
    logged: bool

    @staticmethod
    def of(arrays: Any, static: Any, logged: bool) -> LoopSignature:
        """Return the key of a loop's compiled code.

        - `arrays`, `static`: the loop's arrays and its other parts, as `equinox.partition` returns them.
        - `logged`: True if the code writes a log.
        """
        leaves, tree = jax.tree.flatten(arrays)
        others, static_tree = jax.tree.flatten(static)
        return LoopSignature(tree, tuple((x.shape, x.dtype.name) for x in leaves), static_tree, tuple(others), logged)

    @property
    def arrays(self) -> Any:
        """The tree of arrays, with shapes instead of arrays."""
        shapes = [jax.ShapeDtypeStruct(shape, np.dtype(name)) for shape, name in self.shapes]
        return jax.tree.unflatten(self.tree, shapes)

    @property
    def join(self) -> Callable[[Any], Any]:
        """Function that joins arrays with the static parts."""
        static = jax.tree.unflatten(self.static_tree, self.static)
        return lambda arrays: eqx.combine(arrays, static)
