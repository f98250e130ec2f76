"""Rules that translate JAX primitives which move, select or reduce elements of arrays to IR operations."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from typing import Any

import numpy as np

from ..builder import Builder, Values
from ..ir import FLOATS, Number, Value
from .arrays import constant_array, each, fold, full_array, select_element, type_of, value_array


def _broadcast(b: Builder, equation: Any, arrays: list[Values]) -> Values:
    shape, axes = equation.params["shape"], equation.params["broadcast_dimensions"]
    full = [1] * len(shape)
    for axis, length in zip(axes, arrays[0].shape, strict=True):
        full[axis] = length
    return np.broadcast_to(arrays[0].reshape(full), shape)


def _slice(b: Builder, equation: Any, arrays: list[Values]) -> Values:
    starts, limits = equation.params["start_indices"], equation.params["limit_indices"]
    strides = equation.params["strides"] or [1] * len(starts)
    return arrays[0][tuple(slice(*ends) for ends in zip(starts, limits, strides, strict=True))]


def _pad(b: Builder, equation: Any, arrays: list[Values]) -> Values:
    array, padding = arrays
    low, high, between = ([int(k) for k in part] for part in zip(*equation.params["padding_config"], strict=True))
    spread = [length + max(length - 1, 0) * gap for length, gap in zip(array.shape, between, strict=True)]
    full = [max(lo, 0) + length + max(hi, 0) for lo, length, hi in zip(low, spread, high, strict=True)]
    result = full_array(padding.item(), tuple(full))
    result[
        tuple(
            slice(max(lo, 0), max(lo, 0) + length, gap + 1)
            for lo, length, gap in zip(low, spread, between, strict=True)
        )
    ] = array
    # A negative padding removes elements.
    return result[tuple(slice(max(-lo, 0), n - max(-hi, 0)) for lo, hi, n in zip(low, high, full, strict=True))]


def _iota(b: Builder, equation: Any, arrays: list[Values]) -> Values:
    shape, along = equation.params["shape"], equation.params["dimension"]
    counted = constant_array(b, np.arange(shape[along], dtype=np.dtype(equation.params["dtype"])))
    return np.broadcast_to(counted.reshape([-1 if k == along else 1 for k in range(len(shape))]), shape)


def _unstack(b: Builder, equation: Any, arrays: list[Values]) -> list[Values]:
    moved = np.moveaxis(arrays[0], equation.params["axis"], 0)
    return [moved[k : k + 1].reshape(moved.shape[1:]) for k in range(moved.shape[0])]


def _split(b: Builder, equation: Any, arrays: list[Values]) -> list[Values]:
    ends = np.cumsum(equation.params["sizes"])[:-1]
    return list(np.split(arrays[0], ends, axis=equation.params["axis"]))


def _expand(b: Builder, equation: Any, arrays: list[Values]) -> Values:
    return arrays[0].reshape(equation.outvars[0].aval.shape)


def _empty(b: Builder, equation: Any, arrays: list[Values]) -> Values:
    return full_array(b.constant(0, type_of(equation.outvars[0].aval.dtype)), equation.outvars[0].aval.shape)


SHAPE_RULES: dict[str, Callable[[Builder, Any, list[Values]], Values | list[Values]]] = {
    "broadcast_in_dim": _broadcast,
    "reshape": _expand,
    "squeeze": _expand,
    "expand_dims": _expand,
    "slice": _slice,
    "pad": _pad,
    "iota": _iota,
    "transpose": lambda b, eqn, arrays: arrays[0].transpose(eqn.params["permutation"]),
    "rev": lambda b, eqn, arrays: np.flip(arrays[0], eqn.params["dimensions"]),
    "concatenate": lambda b, eqn, arrays: np.concatenate(arrays, axis=eqn.params["dimension"]),
    "stack": lambda b, eqn, arrays: np.stack(arrays, axis=eqn.params["axis"]),
    "unstack": _unstack,
    "split": _split,
    "empty": _empty,
    "optimization_barrier": lambda b, eqn, arrays: arrays,
    "device_put": lambda b, eqn, arrays: arrays,
}
"""Rule of each primitive, by its name."""


def window(b: Builder, array: Values, starts: list[Value], sizes: tuple[int, ...]) -> Values:
    """Return a part of an array (as `lax.dynamic_slice`); a part that would leave the array is shifted inside.

    - `starts`: for each axis, the part's first index, as an integer IR value that is known only at run time.
    - `sizes`: shape of the part.
    """
    for axis, (start, size) in enumerate(zip(starts, sizes, strict=True)):
        count = array.shape[axis] - size + 1
        parts = [np.take(array, range(k, k + size), axis=axis) for k in range(count)]
        array = parts[0] if count == 1 else each(lambda *row, at=start: select_element(b, list(row), at), *parts)
    return array


def replace_window(b: Builder, array: Values, part: Values, starts: list[Value]) -> Values:
    """Return a copy of an array in which `part` replaces some elements (as `lax.dynamic_update_slice`).

    A part that would leave the array is shifted inside.

    - `part`: new elements, with as many axes as the array.
    - `starts`: for each axis, the part's first index, as an integer IR value that is known only at run time.
    """

    def at(slices: tuple[slice, ...], axis: int) -> Values:
        if axis == array.ndim:
            result = array.copy()
            result[slices] = part
            return result
        size = part.shape[axis]
        results = [at((*slices, slice(k, k + size)), axis + 1) for k in range(array.shape[axis] - size + 1)]
        if len(results) == 1:
            return results[0]
        return each(lambda *row: select_element(b, list(row), starts[axis]), *results)

    return at((), 0)


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
    """Return the first index of a window on each axis, from the entry `where` of the array of indices."""
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
    "dynamic_slice": lambda b, eqn, arrays: window(
        b, arrays[0], [start.item() for start in arrays[1:]], tuple(eqn.params["slice_sizes"])
    ),
    "dynamic_update_slice": lambda b, eqn, arrays: replace_window(
        b, arrays[0], arrays[1], [start.item() for start in arrays[2:]]
    ),
    "gather": _gather,
    "scatter": _scatter(None),
    # JAX writes `scatter-add` or `scatter_add`, depending on its version.
    **{f"scatter{sign}{op}": _scatter(op) for sign in "-_" for op in ("add", "mul", "min", "max")},
}
"""Rule of each primitive, by its name."""


def _reduction(op: str, empty: Number) -> Callable[[Builder, Any, list[Values]], Values]:
    def rule(b: Builder, equation: Any, arrays: list[Values]) -> Values:
        array, axes = arrays[0], tuple(equation.params["axes"])
        kept = [axis for axis in range(array.ndim) if axis not in axes]
        shape = tuple(array.shape[axis] for axis in kept)
        rows = array.transpose((*kept, *axes)).reshape((_size(shape), _size(array.shape[axis] for axis in axes)))
        kind = type_of(equation.outvars[0].aval.dtype)
        name = {"max": "or", "add": "or", "min": "and", "mul": "and"}.get(op, op) if kind == "b1" else op
        none = b.constant(empty, kind) if np.isfinite(empty) or kind in FLOATS else b.constant(0, kind)
        return value_array((fold(lambda x, y: b.apply(name, x, y), row, none) for row in rows), shape)

    return rule


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
    """Return the rule for the index of the largest or smallest element; the first of equal ones, or the first NaN.

    - `better`: "gt" for the largest element, "lt" for the smallest.
    """

    def rule(b: Builder, equation: Any, arrays: list[Values]) -> Values:
        (axis,) = equation.params["axes"]
        moved = np.moveaxis(arrays[0], axis, -1)
        kind = type_of(equation.outvars[0].aval.dtype)

        def first(row: list[Value]) -> Value:
            best, index = row[0], b.constant(0, kind)
            for k, value in enumerate(row[1:], start=1):
                is_better = _is_better(b, better, value, best)
                best = b.apply("select", is_better, value, best)
                index = b.apply("select", is_better, b.constant(k, kind), index)
            return index

        rows = moved.reshape(-1, moved.shape[-1])
        return value_array((first(list(row)) for row in rows), moved.shape[:-1])

    return rule


def _is_better(b: Builder, better: str, value: Value, best: Value) -> Value:
    if value.type == "b1":
        yes, no = (value, best) if better == "gt" else (best, value)
        return b.apply("and", yes, b.apply("not", no))
    is_better = b.apply(better, value, best)
    if value.type in FLOATS:
        new_nan = b.apply("and", b.apply("ne", value, value), b.apply("eq", best, best))
        is_better = b.apply("or", is_better, new_nan)
    return is_better


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
