"""Reductions, cumulative operations and products of arrays."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from slidax.codegen.builder import Builder, Values
from slidax.codegen.ir import FLOATS, Number, Type, Value

from .arrays import fold, type_of, value_array


def _reduction(op: str, empty: Number) -> Callable[[Builder, Any, list[Values]], Values]:
    def rule(b: Builder, equation: Any, arrays: list[Values]) -> Values:
        array, axes = arrays[0], tuple(equation.params["axes"])
        kept = [axis for axis in range(array.ndim) if axis not in axes]
        shape = tuple(array.shape[axis] for axis in kept)
        rows = array.transpose((*kept, *axes)).reshape((_size(shape), _size(array.shape[axis] for axis in axes)))
        kind = type_of(equation.outvars[0].aval.dtype)
        name = _typed_operation(op, kind)
        none = b.constant(empty, kind) if np.isfinite(empty) or kind in FLOATS else b.constant(0, kind)
        return value_array((fold(lambda x, y: b.apply(name, x, y), row, none) for row in rows), shape)

    return rule


def _typed_operation(op: str, kind: Type) -> str:
    return {"max": "or", "add": "or", "min": "and", "mul": "and"}.get(op, op) if kind == "b1" else op


def _size(lengths: Any) -> int:
    return int(np.prod(list(lengths), dtype=int))


def _cumulative(op: str) -> Callable[[Builder, Any, list[Values]], Values]:
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


def _arg_extremum(better: str) -> Callable[[Builder, Any, list[Values]], Values]:
    """Index of the first largest or smallest element; NaN counts as such."""

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
        return value_array((first(list(row)) for row in rows), moved.shape[:-1])

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
    return value_array(entries, (*shared_shape, *rows, *columns))


REDUCTION_RULES: dict[str, Callable[[Builder, Any, list[Values]], Values]] = {
    "reduce_sum": _reduction("add", 0),
    "reduce_prod": _reduction("mul", 1),
    "reduce_max": _reduction("max", -np.inf),
    "reduce_min": _reduction("min", np.inf),
    "reduce_and": _reduction("and", True),
    "reduce_or": _reduction("or", False),
    "reduce_xor": _reduction("xor", False),
    "cumsum": _cumulative("add"),
    "cumprod": _cumulative("mul"),
    "cummax": _cumulative("max"),
    "cummin": _cumulative("min"),
    "argmax": _arg_extremum("gt"),
    "argmin": _arg_extremum("lt"),
    "dot_general": _dot,
}
"""Rule of each primitive, by its name."""
