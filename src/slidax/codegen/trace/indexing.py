"""Primitives with run-time indices."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from typing import Any

import numpy as np

from slidax.codegen.builder import Builder, Values
from slidax.codegen.ir import FLOATS, Value

from .arrays import each, select_element, value_array


def window(b: Builder, array: Values, starts: list[Value], sizes: tuple[int, ...]) -> Values:
    """Return the part of an array from `starts` on, shifted inside where it would leave the array.

    - `starts`: an integer for each axis.
    - `sizes`: shape of the part.
    """
    for axis, (start, size) in enumerate(zip(starts, sizes, strict=True)):
        places = array.shape[axis] - size + 1
        parts = [np.take(array, range(k, k + size), axis=axis) for k in range(places)]
        array = parts[0] if places == 1 else each(lambda *row, at=start: select_element(b, list(row), at), *parts)
    return array


def replace_window(b: Builder, array: Values, part: Values, starts: list[Value]) -> Values:
    """Return the array with a part replaced from `starts` on, shifted inside where it would leave the array.

    - `part`: with as many axes as the array.
    - `starts`: an integer for each axis.
    """

    def at(places: tuple[slice, ...], axis: int) -> Values:
        if axis == array.ndim:
            result = array.copy()
            result[places] = part
            return result
        size = part.shape[axis]
        results = [at((*places, slice(k, k + size)), axis + 1) for k in range(array.shape[axis] - size + 1)]
        if len(results) == 1:
            return results[0]
        return each(lambda *row: select_element(b, list(row), starts[axis]), *results)

    return at((), 0)


def _dynamic_slice(b: Builder, equation: Any, arrays: list[Values]) -> Values:
    return window(b, arrays[0], [start.item() for start in arrays[1:]], tuple(equation.params["slice_sizes"]))


def _dynamic_update_slice(b: Builder, equation: Any, arrays: list[Values]) -> Values:
    return replace_window(b, arrays[0], arrays[1], [start.item() for start in arrays[2:]])


def _inside(b: Builder, starts: list[Value], sizes: tuple[int, ...], shape: tuple[int, ...]) -> Value:
    answer = b.constant(True, "b1")
    for start, size, length in zip(starts, sizes, shape, strict=True):
        zero, last = b.constant(0, start.type), b.constant(length - size, start.type)
        inside = b.apply("and", b.apply("ge", start, zero), b.apply("le", start, last))
        answer = b.apply("and", answer, inside)
    return answer


def _starts(
    b: Builder, indices: Values, where: tuple[int, ...], axes: Any, rank: int, batching: list[tuple[int, int]]
) -> list[Value]:
    """Start of the window that belongs to one entry of the array of indices."""
    row = indices[where]
    zero = b.constant(0, row[0].type if row.size else "i32")
    starts = [zero] * rank
    for axis, value in zip(axes, row, strict=True):
        starts[axis] = value
    for axis, place in batching:
        starts[axis] = b.constant(where[place], zero.type)
    return starts


def _drops(equation: Any) -> bool:
    return "FILL_OR_DROP" in str(equation.params["mode"])


def _gather(b: Builder, equation: Any, arrays: list[Values]) -> Values:
    array, indices = arrays
    numbers, sizes = equation.params["dimension_numbers"], tuple(equation.params["slice_sizes"])
    collapsed = (*numbers.collapsed_slice_dims, *numbers.operand_batching_dims)
    batching = list(zip(numbers.operand_batching_dims, numbers.start_indices_batching_dims, strict=True))
    shape = equation.outvars[0].aval.shape
    result = np.empty(shape, object)
    others = [axis for axis in range(len(shape)) if axis not in numbers.offset_dims]
    for where in itertools.product(*map(range, indices.shape[:-1])):
        starts = _starts(b, indices, where, numbers.start_index_map, array.ndim, batching)
        part = window(b, array, starts, sizes)
        if _drops(equation):
            inside = _inside(b, starts, sizes, array.shape)
            kind = part.flat[0].type
            fill = b.constant(float("nan") if kind in FLOATS else 0, kind)
            part = each(lambda x, ok=inside, no=fill: b.apply("select", ok, x, no), part)
        part = part.reshape([size for axis, size in enumerate(sizes) if axis not in collapsed])
        place: list[Any] = [slice(None)] * len(shape)
        for axis, k in zip(others, where, strict=True):
            place[axis] = k
        result[tuple(place)] = part if part.ndim else part.item()
    return result


def _scatter(combine: str | None) -> Callable[[Builder, Any, list[Values]], Values]:
    def rule(b: Builder, equation: Any, arrays: list[Values]) -> Values:
        array, indices, updates = arrays
        numbers = equation.params["dimension_numbers"]
        inserted = (*numbers.inserted_window_dims, *numbers.operand_batching_dims)
        batching = list(zip(numbers.operand_batching_dims, numbers.scatter_indices_batching_dims, strict=True))
        others = [axis for axis in range(updates.ndim) if axis not in numbers.update_window_dims]
        for where in itertools.product(*map(range, indices.shape[:-1])):
            starts = _starts(b, indices, where, numbers.scatter_dims_to_operand_dims, array.ndim, batching)
            place: list[Any] = [slice(None)] * updates.ndim
            for axis, k in zip(others, where, strict=True):
                place[axis] = k
            picked = updates[tuple(place)]
            part = picked if isinstance(picked, np.ndarray) else value_array([picked], ())
            part = np.expand_dims(part, tuple(sorted(inserted)))
            sizes = part.shape
            if combine is not None:
                part = each(lambda x, y: b.apply(combine, x, y), window(b, array, starts, sizes), part)
            changed = replace_window(b, array, part, starts)
            if _drops(equation):
                inside = _inside(b, starts, sizes, array.shape)
                changed = each(lambda new, old, ok=inside: b.apply("select", ok, new, old), changed, array)
            array = changed
        return array

    return rule


INDEXING_RULES: dict[str, Callable[[Builder, Any, list[Values]], Values]] = {
    "dynamic_slice": _dynamic_slice,
    "dynamic_update_slice": _dynamic_update_slice,
    "gather": _gather,
    "scatter": _scatter(None),
    "scatter-add": _scatter("add"),
    "scatter-mul": _scatter("mul"),
    "scatter-min": _scatter("min"),
    "scatter-max": _scatter("max"),
    "scatter_mul": _scatter("mul"),
    "scatter_min": _scatter("min"),
    "scatter_max": _scatter("max"),
}
"""Rule of each primitive, by its name."""
