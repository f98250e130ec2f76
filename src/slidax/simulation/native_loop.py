"""The whole closed loop in the intermediate representation: beginning, time loop, log."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import equinox as eqx
import jax
import numpy as np

from slidax._types import State
from slidax.codegen.builder import Builder, Values
from slidax.codegen.ir import Program, Value
from slidax.codegen.no_native_code import in_one_line
from slidax.codegen.trace import inline
from slidax.codegen.trace.arrays import filled, of_numbers
from slidax.codegen.trace.packed import packed, unpacked
from slidax.codegen.trace.trace import ir_type, leaves

from .loop import Loop
from .rollout import begin, sample

Define = Callable[[Any], tuple[Loop, State]]
"""From arrays to a loop and the state at t = 0."""


@dataclass(frozen=True)
class NativeLoop:
    """A closed loop as a program, with what its arrays mean.

    Its inputs are `consts`, the arrays it is made from, `steps`, and then, if something is logged, `every`, and, if it
    is the loop of one run, `fresh` and the carry to go on with. Its outputs are the log's arrays, row by row, and then
    those of `begun`, with the carry after the last sample.

    - `program`: in the intermediate representation.
    - `consts`: arrays that it closes over.
    - `begun`: `(carry, envelope, reference)`, with shapes for arrays.
    - `log`: that of one sample, with shapes for arrays; None if nothing is logged.
    """

    program: Program
    consts: tuple[np.ndarray, ...]
    begun: Any
    log: Any


def single_loop(define: Define, arrays: Any, *, logged: bool) -> NativeLoop:
    """The loop of one run: `steps` samples from the beginning if `fresh`, else from a carry on; ends at a fault.

    - `define`: makes it.
    - `arrays`: what it is made from.
    - `logged`: whether one in `every` samples is logged.
    """
    return lowered(*_parts(define), arrays, logged=logged, batch=False)


def batch_loop(define: Define, arrays: Any, *, logged: bool) -> NativeLoop:
    """The loop of each run of a batch, from the beginning; runs that are over stand still until all have ended.

    - `define`: makes it.
    - `arrays`: what it is made from, of one run.
    - `logged`: whether one in `every` samples is logged.
    """
    return lowered(*_parts(define), arrays, logged=logged, batch=True)


def _parts(define: Define) -> tuple[Callable[..., Any], Callable[..., Any]]:
    return (lambda given: begin(*define(given))), (lambda given, carry: sample(define(given)[0], carry))


def lowered(
    begun: Callable[..., Any],
    turned: Callable[..., Any],
    arrays: Any,
    *,
    logged: bool,
    batch: bool,
    shared: Any = None,
    beforehand: Callable[[Any], Any] | None = None,
) -> NativeLoop:
    """The loop of two functions of arrays.

    - `begun`: from what the loop is made from to `(carry, envelope, reference)`.
    - `turned`: from that and a carry to the next carry and one line of the log.
    - `arrays`: what it is made from, of one run.
    - `logged`: whether one in `every` samples is logged.
    - `batch`: whether many are to run side by side.
    - `shared`: a tree before `arrays` that is the same for all runs of a batch; both are then given as a pair.
    - `beforehand`: from `arrays` to what both functions are given in their place, computed once before all samples.
    """
    given = arrays if shared is None else (shared, arrays)
    before = None if beforehand is None else _Traced(beforehand, given)
    found = given if before is None else before.result
    start = _Traced(begun, found)
    turn = _Traced(turned, found, start.result[0])
    # What fails above fails by XLA too, and says so itself.
    with in_one_line(lambda: "the loop"):
        return _program(before, start, turn, given, logged, batch, len(jax.tree.leaves(shared)))


def _program(
    before: _Traced | None,
    start: _Traced,
    turn: _Traced,
    arrays: Any,
    logged: bool,
    batch: bool,
    shared: int,
) -> NativeLoop:
    b = Builder()
    outside = _Outside(b)
    of_before = [] if before is None else outside.inputs(before.jaxpr.consts)
    of_start, of_turn = outside.inputs(start.jaxpr.consts), outside.inputs(turn.jaxpr.consts)
    given = [
        b.input(name, ir_type(leaf.dtype, name), leaf.shape, varying=batch and place >= shared)
        for place, (name, leaf) in enumerate(leaves((jax.tree.map(_shape, arrays),), ("",)))
    ]
    if before is not None:
        b.origin = BEFOREHAND
        given = [_as_given(b, k, array) for k, array in enumerate(inline(b, before.jaxpr, given, constants=of_before))]
        b.origin = None
    steps = b.input("steps", "i64", ()).item()
    every = b.input("every", "i64", ()).item() if logged else None
    rows = [
        (b.logged(name, ir_type(leaf.dtype, name), leaf.shape) if logged else 0)
        for name, leaf in leaves((turn.result[1],), ("log",))
    ]
    carried = len(jax.tree.leaves(start.result[0]))
    begun = _begun(b, start, lambda: inline(b, start.jaxpr, given, constants=of_start), carried, batch)
    fault = _place_of_fault(start.result[0])
    shapes = [array.shape for array in begun[:carried]]
    zero, one = b.constant(0, "i64"), b.constant(1, "i64")

    def unfinished(numbers: Sequence[Value]) -> Value:
        more = b.apply("lt", numbers[0], steps)
        if batch:
            return more
        found = unpacked(numbers[3:], shapes)[fault].item()
        return b.apply("and", more, b.apply("eq", found, b.constant(0, found.type)))

    def following(numbers: Sequence[Value]) -> list[Value]:
        count, left, row = numbers[:3]
        results = inline(b, turn.jaxpr, [*given, *unpacked(numbers[3:], shapes)], constants=of_turn)
        if every is not None:
            due = b.apply("eq", left, zero)
            for output, values in zip(rows, results[carried:], strict=True):
                b.store(output, row, due, values)
            left = b.apply("sub", b.apply("select", due, every, left), one)
            row = b.apply("add", row, b.apply("convert", due, type="i64"))
        return [b.apply("add", count, one), left, row, *packed(results[:carried])]

    ended = b.loop([zero, zero, zero, *packed(begun[:carried])], unfinished, following, steps if batch else None)
    results = [*unpacked(ended[3:], shapes), *begun[carried:]]
    for (name, leaf), values in zip(leaves((start.result,), ("",)), results, strict=True):
        b.output(name, ir_type(leaf.dtype, name), values)
    return NativeLoop(b.finish(), tuple(outside.arrays), start.result, turn.result[1] if logged else None)


def _begun(b: Builder, start: _Traced, afresh: Callable[[], list[Values]], carried: int, batch: bool) -> list[Values]:
    """The carry, and after it envelope and reference: computed, or for a run that goes on given, the latter as 0."""
    if batch:
        return afresh()
    fresh = b.input("fresh", "b1", ()).item()
    found = leaves((start.result,), ("",))
    inputs = [b.input(name, ir_type(leaf.dtype, name), leaf.shape) for name, leaf in found[:carried]]
    nothing = [filled(b.constant(0, ir_type(leaf.dtype, name)), leaf.shape) for name, leaf in found[carried:]]
    given = [*inputs, *nothing]
    values = b.branch(fresh, lambda: packed(afresh()), lambda: packed(given))
    return unpacked(values, [array.shape for array in given])


BEFOREHAND = "beforehand"
"""Where values come from that a run is given, and does not compute."""


def _as_given(b: Builder, which: int, array: Values) -> Values:
    """Values as unknown as those of an input, so that the loop's own rounding is as it is there."""
    found = np.empty(array.size, object)
    for k, value in enumerate(array.ravel()):
        found[k] = b.apply("copy", value, type=value.type, data=(which, k))
    return found.reshape(array.shape)


class _Traced:
    """A function's jaxpr, and its result with shapes for arrays."""

    def __init__(self, function: Callable[..., Any], *args: Any) -> None:
        rest: list[Any] = []

        def arrays_of(*args: Any) -> Any:
            arrays, static = eqx.partition(function(*args), eqx.is_array)
            rest[:] = [static]
            return arrays

        shapes = jax.tree.map(_shape, args)
        self.jaxpr, arrays = jax.make_jaxpr(arrays_of, return_shape=True)(*shapes)
        self.result = eqx.combine(arrays, rest[0], is_leaf=lambda x: x is None)


class _Outside:
    """The arrays that functions close over, each an input once."""

    def __init__(self, builder: Builder) -> None:
        self.builder = builder
        self.arrays: list[np.ndarray] = []
        self._known: dict[int, Values] = {}

    def inputs(self, consts: Sequence[Any]) -> list[Values]:
        found = []
        for const in consts:
            # A mask or an index that the code itself holds: what it switches off is not to be computed.
            if not isinstance(const, jax.Array) and np.asarray(const).dtype.kind in "bi":
                found.append(of_numbers(self.builder, np.asarray(const)))
                continue
            if id(const) not in self._known:
                name = f"const{len(self.arrays)}"
                self._known[id(const)] = self.builder.input(name, ir_type(const.dtype, name), np.shape(const))
                self.arrays.append(np.asarray(const))
            found.append(self._known[id(const)])
        return found


def _place_of_fault(carry: Any) -> int:
    """Which of the carry's arrays says whether something went wrong."""
    marked = eqx.tree_at(lambda c: c.fault.kind, carry, None, is_leaf=lambda x: x is None)
    before = [name for name, _ in leaves((carry,), ("",))]
    (missing,) = set(before) - {name for name, _ in leaves((marked,), ("",))}
    return before.index(missing)


def _shape(x: Any) -> jax.ShapeDtypeStruct:
    return jax.ShapeDtypeStruct(np.shape(x), x.dtype)
