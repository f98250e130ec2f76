"""NumPy arrays of IR values: the operands and results of JAX primitives while a function is traced."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np

from ..builder import Builder, Values
from ..ir import DTYPES, Type, Value

TYPES: dict[str, Type] = {np.dtype(dtype).name: type for type, dtype in DTYPES.items()}
"""IR type of each dtype."""


Inline = Callable[[Any, Sequence[Values]], list[Values]]
"""Append the operations of a closed jaxpr to a program: map the jaxpr and its arguments to its results."""


def type_of(dtype: Any) -> Type:
    """Return the IR type for a NumPy dtype.

    Raises NotImplementedError if the IR has no such type.
    """
    name = np.dtype(dtype).name
    if name not in TYPES:
        raise NotImplementedError(f"arrays of {name}; use float64, int64 or bool")
    return TYPES[name]


def value_array(values: Iterable[Value], shape: tuple[int, ...]) -> Values:
    """Return IR values, listed in C order, as an array of shape `shape`."""
    listed = list(values)
    array = np.empty(len(listed), object)
    array[:] = listed
    return array.reshape(shape)


def constant_array(builder: Builder, numbers: Any) -> Values:
    """Return an array of numbers as an array of constant IR values; `TYPES` has the allowed dtypes."""
    array = np.asarray(numbers)
    kind = type_of(array.dtype)
    return value_array((builder.constant(number, kind) for number in array.ravel().tolist()), array.shape)


def full_array(value: Value, shape: tuple[int, ...]) -> Values:
    """Return an array of shape `shape` that has the same IR value in all elements."""
    array = np.empty(shape, object)
    array[...] = value
    return array


def each(function: Callable[..., Value], *arrays: Values) -> Values:
    """Broadcast arrays of IR values, apply a function element by element, and return the array of the results."""
    if all(array.ndim == 0 for array in arrays):
        return value_array([function(*(array.item() for array in arrays))], ())
    arrays = tuple(np.broadcast_arrays(*arrays)) if len(arrays) > 1 else arrays
    return value_array(
        [function(*row) for row in zip(*(array.ravel() for array in arrays), strict=True)], arrays[0].shape
    )


def fold(function: Callable[[Value, Value], Value], values: Iterable[Value], empty: Value) -> Value:
    """Return `function(... function(v1, v2) ..., vn)`, or `empty` for no values."""
    result: Value | None = None
    for value in values:
        result = value if result is None else function(result, value)
    return empty if result is None else result


def select_element(builder: Builder, values: list[Value], index: Value) -> Value:
    """Return the IR value of `values[index]`, where `index` is an integer that is known only at run time.

    An index out of range is clipped to the range.
    """
    last = len(values) - 1
    if index.op == "const":
        return values[max(0, min(last, int(index.data)))]
    if all(value is values[0] for value in values):
        return values[0]
    if last >= LONG or _progression(values) is not None:
        inside = builder.apply("max", index, builder.constant(0, index.type))
        inside = builder.apply("min", inside, builder.constant(last, index.type))
        computed = _compute_element(builder, values, inside)
        if computed is not None:
            return computed
    answer = values[-1]
    for k in reversed(range(last)):
        up_to_here = builder.apply("le", index, builder.constant(k, index.type))
        answer = builder.apply("select", up_to_here, values[k], answer)
    return answer


LONG = 16
"""Largest length of an array whose elements are chosen at run time by a chain of selections, even if they are inputs.

A longer array is read from memory if it consists of evenly spaced elements of one input.
"""


def _compute_element(builder: Builder, values: list[Value], index: Value) -> Value | None:
    """Return an element: computed from an arithmetic progression, or loaded from evenly spaced inputs; else None."""
    numbers = _progression(values)
    if numbers is not None:
        kind, (start, step) = values[0].type, numbers
        scaled = builder.apply("mul", builder.apply("convert", index, type=kind), builder.constant(step, kind))
        return builder.apply("add", scaled, builder.constant(start, kind))
    if any(value.op != "input" for value in values):
        return None
    which, start = values[0].data
    step = values[1].data[1] - start
    if any(value.data != (which, start + k * step) for k, value in enumerate(values)):
        return None
    position = builder.apply("mul", builder.apply("convert", index, type="i64"), builder.constant(step, "i64"))
    position = builder.apply("add", position, builder.constant(start, "i64"))
    return builder.apply("load", position, type=values[0].type, data=which)


def _progression(values: list[Value]) -> tuple[int, int] | None:
    """Return start and step of evenly spaced integer constants, such as those from `arange`; None for other values."""
    if len(values) < 2 or any(value.op != "const" or value.type not in ("i64", "i32") for value in values):
        return None
    numbers = [int(value.data) for value in values]
    step = numbers[1] - numbers[0]
    even = all(after - before == step for before, after in itertools.pairwise(numbers))
    return (numbers[0], step) if even else None


def pack(arrays: Sequence[Values]) -> list[Value]:
    """Return the elements of arrays, one array after the other, each in C order."""
    return [value for array in arrays for value in array.ravel()]


def unpack(values: Sequence[Value], shapes: Sequence[tuple[int, ...]]) -> list[Values]:
    """Return arrays of given shapes, filled with the elements in `values`; the inverse of `pack`."""
    arrays, start = [], 0
    for shape in shapes:
        size = int(np.prod(shape, dtype=int))
        arrays.append(value_array(values[start : start + size], shape))
        start += size
    return arrays
