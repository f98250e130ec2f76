"""Shared functions: a long function under `jax.jit` becomes a separate program."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..builder import Builder, Values
from ..ir import BLOCKS, PLACED, Call, Program, Value, digest
from .arrays import type_of, value_array

ROW = 3
"""Least number of elements of an array that stays an array in the program."""

WORTH = 60
"""Least number of operations of a function that is not inlined."""

EACH = 2.5
"""Least number of operations per element of the results of a function that is not inlined."""


@dataclass(frozen=True)
class SharedProgram:
    """A function that is traced once, as a program of its own, for calls that have equal constants in their arguments.

    - `program`: the program; None if the function is inlined at each call.
    - `passed`: indices of the arguments that are inputs of the program; the others are constant or unused.
    - `results`: for each result, its shape, and the source of each element: ("const", number), ("input", index among
      all elements of the passed arguments) or ("output", index among the elements of the program's output).
    - `jaxpr`: stored here to stay alive, so that no other jaxpr gets its `id`.
    """

    program: Program | None
    passed: list[int]
    results: list[tuple[tuple[int, ...], list[Any]]]
    jaxpr: Any


class Library:
    """Collection of shared functions: all programs that are traced with it call the same program for equal calls."""

    def __init__(self) -> None:
        self._shared: dict[Any, SharedProgram] = {}
        self._programs: dict[str, Program] = {}

    def call(
        self, builder: Builder, equation: Any, arrays: Sequence[Values], run: Callable[..., list[Values]]
    ) -> list[Values] | None:
        """Add the call of a shared function to a program, and return its results; None if the call must be inlined.

        - `builder`: builder of the program.
        - `equation`: the jaxpr's equation that calls a function under `jax.jit`.
        - `arrays`: arguments of the call, as arrays of IR values.
        - `run`: function that traces a closed jaxpr, with arguments and a name, into another builder.
        """
        closed = equation.params["jaxpr"]
        if not _fits(closed.jaxpr):
            return None
        # Constants are folded instead of passed.
        known = tuple(tuple(_number(value) for value in array.ravel()) for array in arrays)
        key = (id(closed), known)
        if key not in self._shared:
            self._shared[key] = self._shared_program(closed, str(equation.params.get("name", "")), arrays, run)
        shared = self._shared[key]
        if shared.program is None:
            return None
        args = [value for k in shared.passed for value in arrays[k].ravel()]
        outputs = builder.call(shared.program, args)

        def element(key: Any) -> Value:
            kind, data = key
            if kind == "const":
                return builder.constant(data, "f64")
            return args[data] if kind == "input" else outputs[data]

        return [value_array([element(key) for key in elements], shape) for shape, elements in shared.results]

    def _shared_program(
        self, closed: Any, name: str, arrays: Sequence[Values], run: Callable[..., list[Values]]
    ) -> SharedProgram:
        inlined = SharedProgram(None, [], [], closed)
        if _length(closed.jaxpr) < WORTH:
            return inlined
        builder = Builder()
        jaxpr = closed.jaxpr
        used = {atom for equation in jaxpr.eqns for atom in equation.invars if not hasattr(atom, "val")}
        used.update(atom for atom in jaxpr.outvars if not hasattr(atom, "val"))
        passed: list[int] = []
        inside: list[Values] = []
        for k, array in enumerate(arrays):
            atom = closed.jaxpr.invars[k]
            if atom.aval.dtype == np.bool_ and atom in used:
                # Both truth values share a function.
                passed.append(k)
                inside.append(builder.input(f"x{k}", "b1", ()))
                continue
            if atom not in used or all(value.op == "const" for value in array.flat):
                numbers = [value.data if value.op == "const" else 0.0 for value in array.flat]
                inside.append(value_array([builder.constant(number, "f64") for number in numbers], array.shape))
                continue
            passed.append(k)
            own = builder.input(f"x{k}", type_of(np.float64), array.shape)
            mixed = [
                builder.constant(old.data, old.type) if old.op == "const" else new
                for old, new in zip(array.flat, own.flat, strict=True)
            ]
            inside.append(value_array(mixed, array.shape))
        results = run(builder, closed, inside, name)
        pairs = [(k, element) for k, which in enumerate(passed) for element in range(arrays[which].size)]
        at = {pair: number for number, pair in enumerate(pairs)}
        outputs: list[Value] = []
        keys: list[tuple[tuple[int, ...], list[Any]]] = []
        elements: list[Any]
        for result in results:
            values = list(result.flat)
            if all(value.op == "const" for value in values):
                elements = [("const", value.data) for value in values]
            elif all(value.op == "input" for value in values) and _in_order(values):
                elements = [("input", at[value.data]) for value in values]
            else:
                # All elements, so that the array stays contiguous.
                elements = [("output", len(outputs) + k) for k in range(len(values))]
                outputs += values
            keys.append((result.shape, elements))
        builder.output("result", "f64", value_array(outputs, (len(outputs),)))
        builder.program.name = name.strip("_") or "function"
        program = builder.finish()
        if _cost(program) < max(WORTH, EACH * len(outputs)):
            return inlined
        # Traces of the same function share a program.
        return SharedProgram(self._programs.setdefault(digest(program), program), passed, keys, closed)


def _in_order(values: Sequence[Value]) -> bool:
    """True if inputs are consecutive elements of one array."""
    which, first = values[0].data
    return all(value.data == (which, first + k) for k, value in enumerate(values))


def keep_array(builder: Builder, array: Values) -> Values:
    """Record that IR values form one array in the Python source, and return this array.

    Elements that need no computation, such as inputs, are replaced by copies in the array; constants are not. An array
    with only such elements, or with fewer than `ROW` elements, is returned unchanged and not recorded.
    """
    if array.size < ROW or all(value.op in PLACED for value in array.flat):
        return array
    which = len(builder.program.arrays)
    placed = [
        builder.apply("copy", value, data=which) if value.op in PLACED and value.op != "const" else value
        for value in array.flat
    ]
    builder.program.arrays.append(tuple(placed))
    return value_array(placed, array.shape)


def _number(value: Value) -> Any:
    return value.data.hex() if value.op == "const" and value.type == "f64" else None


def _cost(program: Program) -> int:
    """Return the number of operations of a program, including its callees."""
    return sum(
        _cost(value.program) if isinstance(value, Call) else value.op not in PLACED and value.op not in BLOCKS
        for value in program.walk()
    )


def _fits(jaxpr: Any) -> bool:
    """True if all arguments are doubles or scalar truth values, and all results doubles."""
    return all(
        atom.aval.dtype == np.float64 or (atom.aval.dtype == np.bool_ and atom.aval.shape == ())
        for atom in jaxpr.invars
    ) and all(atom.aval.dtype == np.float64 for atom in jaxpr.outvars)


def _length(jaxpr: Any) -> int:
    """Estimate the number of operations, without inner jaxprs."""
    return sum(atom.aval.size for equation in jaxpr.eqns for atom in (*equation.invars, *equation.outvars))
