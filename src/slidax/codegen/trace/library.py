"""Functions that stay functions: what the source wraps in `jax.jit`, and is long, becomes a program of its own."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from slidax.codegen.builder import Builder, Values
from slidax.codegen.digest import digest
from slidax.codegen.ir import BLOCKS, Call, Program, Value

from .arrays import of_list, type_of

Key = tuple[str, Any, int]
"""What an element of a result is: `("const", number, ...)`, `("input", element of the call's)`, `("output", which)`."""

ROW = 3
"""Elements that an array is worth."""

PLACED = frozenset({"const", "input", "param", "result"})
"""Values that lie somewhere already."""

WORTH = 60
"""Operations from which on a function is worth its call."""

EACH = 2.5
"""Operations for each number that it leaves, likewise."""


@dataclass(frozen=True)
class Shared:
    """A function, for calls with the same known numbers among their arguments.

    - `program`: itself; None if it is written out where it is called.
    - `given`: the numbers of the arguments that are its inputs.
    - `results`: for each result what its elements are.
    - `kept`: the jaxpr, so that no other comes to lie where it was.
    """

    program: Program | None
    given: list[int]
    results: list[tuple[tuple[int, ...], list[Any]]]
    kept: Any


class Library:
    """The functions of the programs that are traced with it: what calls the same makes the same calls."""

    def __init__(self) -> None:
        self._shared: dict[Any, Shared] = {}
        self._programs: dict[str, Program] = {}

    def call(
        self, builder: Builder, equation: Any, arrays: Sequence[Values], run: Callable[..., list[Values]]
    ) -> list[Values] | None:
        """The results of a call, None if it is to be written out.

        - `builder`: makes them.
        - `equation`: of the call.
        - `arrays`: its arguments.
        - `run`: from another builder, a closed jaxpr and arguments to results.
        """
        closed = equation.params["jaxpr"]
        if not _fits(closed.jaxpr):
            return None
        # What is known is no argument: it is simplified away.
        known = tuple(tuple(_number(value) for value in array.ravel()) for array in arrays)
        key = (id(closed), known)
        if key not in self._shared:
            self._shared[key] = self._made(closed, str(equation.params.get("name", "")), arrays, run)
        shared = self._shared[key]
        if shared.program is None:
            return None
        args = [value for k in shared.given for value in arrays[k].ravel()]
        made = builder.call(shared.program, args)

        def element(one: Any) -> Value:
            kind, data = one
            if kind == "const":
                return builder.constant(data, "f64")
            return args[data] if kind == "input" else made[data]

        return [of_list([element(one) for one in elements], shape) for shape, elements in shared.results]

    def _made(self, closed: Any, name: str, arrays: Sequence[Values], run: Callable[..., list[Values]]) -> Shared:
        written_out = Shared(None, [], [], closed)
        if _length(closed.jaxpr) < WORTH:
            return written_out
        builder = Builder()
        jaxpr = closed.jaxpr
        used = {atom for equation in jaxpr.eqns for atom in equation.invars if not hasattr(atom, "val")}
        used.update(atom for atom in jaxpr.outvars if not hasattr(atom, "val"))
        given: list[int] = []
        inside: list[Values] = []
        for k, array in enumerate(arrays):
            atom = closed.jaxpr.invars[k]
            if atom.aval.dtype == np.bool_ and atom in used:
                # Both answers are in one function.
                given.append(k)
                inside.append(builder.input(f"x{k}", "b1", ()))
                continue
            if atom not in used or all(value.op == "const" for value in array.flat):
                numbers = [value.data if value.op == "const" else 0.0 for value in array.flat]
                inside.append(of_list([builder.constant(number, "f64") for number in numbers], array.shape))
                continue
            given.append(k)
            own = builder.input(f"x{k}", type_of(np.float64), array.shape)
            mixed = [
                builder.constant(old.data, old.type) if old.op == "const" else new
                for old, new in zip(array.flat, own.flat, strict=True)
            ]
            inside.append(of_list(mixed, array.shape))
        results = run(builder, closed, inside, name)
        places = [(k, element) for k, which in enumerate(given) for element in range(arrays[which].size)]
        at = {place: number for number, place in enumerate(places)}
        outputs: list[Value] = []
        said: list[tuple[tuple[int, ...], list[Any]]] = []
        elements: list[Any]
        for result in results:
            values = list(result.flat)
            if all(value.op == "const" for value in values):
                elements = [("const", value.data) for value in values]
            elif all(value.op == "input" for value in values) and _in_order(values):
                elements = [("input", at[value.data]) for value in values]
            else:
                # All of an array, so that it lies there as one.
                elements = [("output", len(outputs) + k) for k in range(len(values))]
                outputs += values
            said.append((result.shape, elements))
        builder.output("result", "f64", of_list(outputs, (len(outputs),)))
        builder.program.name = name.strip("_") or "function"
        program = builder.finish()
        if _cost(program) < max(WORTH, EACH * len(outputs)):
            return written_out
        # Two traces of one function are one function.
        return Shared(self._programs.setdefault(digest(program), program), given, said, closed)


def _in_order(values: Sequence[Value]) -> bool:
    """Whether inputs lie one after the other."""
    which, first = values[0].data
    return all(value.data == (which, first + k) for k, value in enumerate(values))


def together(builder: Builder, array: Values) -> Values:
    """An array that the source computes as one; an input that is an element of it is copied there.

    - `builder`: of the program.
    - `array`: whose elements are known.
    """
    if array.size < ROW or all(value.op in PLACED for value in array.flat):
        return array
    which = len(builder.program.arrays)
    placed = [
        builder.apply("copy", value, data=which) if value.op in PLACED and value.op != "const" else value
        for value in array.flat
    ]
    builder.program.arrays.append(tuple(placed))
    return of_list(placed, array.shape)


def _number(value: Value) -> Any:
    return value.data.hex() if value.op == "const" and value.type == "f64" else None


def _cost(program: Program) -> int:
    """How many operations a program has, those of what it calls included."""
    return sum(
        _cost(value.program) if isinstance(value, Call) else value.op not in PLACED and value.op not in BLOCKS
        for value in program.walk()
    )


def _fits(jaxpr: Any) -> bool:
    """Whether it takes doubles, and truth values one by one, and gives doubles."""
    return all(
        atom.aval.dtype == np.float64 or (atom.aval.dtype == np.bool_ and atom.aval.shape == ())
        for atom in jaxpr.invars
    ) and all(atom.aval.dtype == np.float64 for atom in jaxpr.outvars)


def _length(jaxpr: Any) -> int:
    """About how many operations there are, those inside of others not counted."""
    return sum(atom.aval.size for equation in jaxpr.eqns for atom in (*equation.invars, *equation.outvars))
