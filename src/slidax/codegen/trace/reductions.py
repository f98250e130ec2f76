"""Primitives that make few elements of many."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from slidax.codegen.builder import Builder, Values
from slidax.codegen.ir import FLOATS, Number, Type, Value

from .arrays import fold, of_list, type_of


def _reduced(op: str, empty: Number) -> Callable[[Builder, Any, list[Values]], Values]:
    def rule(b: Builder, equation: Any, arrays: list[Values]) -> Values:
        array, axes = arrays[0], tuple(equation.params["axes"])
        kept = [axis for axis in range(array.ndim) if axis not in axes]
        shape = tuple(array.shape[axis] for axis in kept)
        rows = array.transpose((*kept, *axes)).reshape((_size(shape), _size(array.shape[axis] for axis in axes)))
        kind = type_of(equation.outvars[0].aval.dtype)
        name = _of_kind(op, kind)
        none = b.constant(empty, kind) if np.isfinite(empty) or kind in FLOATS else b.constant(0, kind)
        return of_list((fold(lambda x, y: b.apply(name, x, y), row, none) for row in rows), shape)

    return rule


def _of_kind(op: str, kind: Type) -> str:
    return {"max": "or", "add": "or", "min": "and", "mul": "and"}.get(op, op) if kind == "b1" else op


def _size(lengths: Any) -> int:
    return int(np.prod(list(lengths), dtype=int))


def _cumulated(op: str) -> Callable[[Builder, Any, list[Values]], Values]:
    def rule(b: Builder, equation: Any, arrays: list[Values]) -> Values:
        axis = equation.params["axis"]
        moved = np.moveaxis(arrays[0], axis, 0)
        if equation.params["reverse"]:
            moved = moved[::-1]
        flat = moved.reshape(moved.shape[0], -1)
        result = flat.copy()
        for row in range(1, flat.shape[0]):
            for column in range(flat.shape[1]):
                result[row, column] = b.apply(op, result[row - 1, column], flat[row, column])
        ordered = result.reshape(moved.shape)
        return np.moveaxis(ordered[::-1] if equation.params["reverse"] else ordered, 0, axis)

    return rule


def _place_of(better: str) -> Callable[[Builder, Any, list[Values]], Values]:
    """The number of the first largest or smallest; NaN counts as such."""

    def rule(b: Builder, equation: Any, arrays: list[Values]) -> Values:
        (axis,) = equation.params["axes"]
        moved = np.moveaxis(arrays[0], axis, -1)
        kind = type_of(equation.outvars[0].aval.dtype)

        def first(row: list[Value]) -> Value:
            best, place = row[0], b.constant(0, kind)
            for k, value in enumerate(row[1:], start=1):
                won = _beats(b, better, value, best)
                best = b.apply("select", won, value, best)
                place = b.apply("select", won, b.constant(k, kind), place)
            return place

        rows = moved.reshape(-1, moved.shape[-1])
        return of_list((first(list(row)) for row in rows), moved.shape[:-1])

    return rule


def _beats(b: Builder, better: str, value: Value, best: Value) -> Value:
    if value.type == "b1":
        yes, no = (value, best) if better == "gt" else (best, value)
        return b.apply("and", yes, b.apply("not", no))
    won = b.apply(better, value, best)
    if value.type in FLOATS:
        new_nan = b.apply("and", b.apply("ne", value, value), b.apply("eq", best, best))
        won = b.apply("or", won, new_nan)
    return won


def _dot(b: Builder, equation: Any, arrays: list[Values]) -> Values:
    (contract, batch), (left, right) = equation.params["dimension_numbers"], arrays
    sides = []
    for array, summed, shared in ((left, contract[0], batch[0]), (right, contract[1], batch[1])):
        free = [axis for axis in range(array.ndim) if axis not in summed and axis not in shared]
        shapes = [tuple(array.shape[axis] for axis in axes) for axes in (shared, free, summed)]
        sides.append((array.transpose((*shared, *free, *summed)).reshape([_size(s) for s in shapes]), shapes))
    (x, (shared_shape, rows, _)), (y, (_, columns, _)) = sides
    kind = type_of(equation.outvars[0].aval.dtype)

    def entry(p: Any, q: Any) -> Value:
        products = (b.apply("mul", u, v) for u, v in zip(p, q, strict=True))
        return fold(lambda u, v: b.apply("add", u, v), products, b.constant(0, kind))

    entries = (entry(p, q) for k in range(x.shape[0]) for p in x[k] for q in y[k])
    return of_list(entries, (*shared_shape, *rows, *columns))


RULES: dict[str, Callable[[Builder, Any, list[Values]], Values]] = {
    "reduce_sum": _reduced("add", 0),
    "reduce_prod": _reduced("mul", 1),
    "reduce_max": _reduced("max", -np.inf),
    "reduce_min": _reduced("min", np.inf),
    "reduce_and": _reduced("and", True),
    "reduce_or": _reduced("or", False),
    "reduce_xor": _reduced("xor", False),
    "cumsum": _cumulated("add"),
    "cumprod": _cumulated("mul"),
    "cummax": _cumulated("max"),
    "cummin": _cumulated("min"),
    "argmax": _place_of("gt"),
    "argmin": _place_of("lt"),
    "dot_general": _dot,
}
"""The rule of each primitive, by its name."""
