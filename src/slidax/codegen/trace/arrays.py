"""Arrays of values: what each rule of a primitive takes and gives."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np

from slidax.codegen.builder import Builder, Values
from slidax.codegen.ir import Type, Value

TYPES: dict[str, Type] = {
    "float64": "f64",
    "float32": "f32",
    "int64": "i64",
    "int32": "i32",
    "uint64": "u64",
    "uint32": "u32",
    "bool": "b1",
}
"""The IR's name of each dtype."""


def type_of(dtype: Any) -> Type:
    """The IR's name of a dtype.

    - `dtype`: NumPy's.

    Raises NotImplementedError if it has none.
    """
    name = np.dtype(dtype).name
    if name not in TYPES:
        raise NotImplementedError(f"arrays of {name}; use float64, int64 or bool")
    return TYPES[name]


def of_list(values: Iterable[Value], shape: tuple[int, ...]) -> Values:
    """An array of values.

    - `values`: in C order.
    - `shape`: its own.
    """
    listed = list(values)
    array = np.empty(len(listed), object)
    array[:] = listed
    return array.reshape(shape)


def of_numbers(builder: Builder, numbers: Any) -> Values:
    """An array of known numbers.

    - `builder`: makes them.
    - `numbers`: anything that NumPy takes, of a type in `TYPES`.
    """
    array = np.asarray(numbers)
    kind = type_of(array.dtype)
    return of_list((builder.constant(number, kind) for number in array.ravel().tolist()), array.shape)


def filled(value: Value, shape: tuple[int, ...]) -> Values:
    """One value everywhere.

    - `value`: it.
    - `shape`: of the array.
    """
    array = np.empty(shape, object)
    array[...] = value
    return array


def each(function: Callable[..., Value], *arrays: Values) -> Values:
    """A function of the elements, for arrays of one shape; scalars go with all.

    - `function`: of one value from each.
    - `arrays`: one shape, or ().
    """
    if all(array.ndim == 0 for array in arrays):
        return of_list([function(*(array.item() for array in arrays))], ())
    arrays = tuple(np.broadcast_arrays(*arrays)) if len(arrays) > 1 else arrays
    return of_list([function(*row) for row in zip(*(array.ravel() for array in arrays), strict=True)], arrays[0].shape)


def fold(function: Callable[[Value, Value], Value], values: Iterable[Value], empty: Value) -> Value:
    """`function(... function(v1, v2) ..., vn)`.

    - `function`: of two.
    - `values`: in order.
    - `empty`: what none at all gives.
    """
    result: Value | None = None
    for value in values:
        result = value if result is None else function(result, value)
    return empty if result is None else result


def chosen(builder: Builder, values: list[Value], index: Value) -> Value:
    """The element with a number that is known only at run time; the first or the last for a number out of range.

    - `builder`: makes it.
    - `values`: the elements.
    - `index`: an integer.
    """
    last = len(values) - 1
    if index.op == "const":
        return values[max(0, min(last, int(index.data)))]
    if all(value is values[0] for value in values):
        return values[0]
    if last >= LONG or _progression(values) is not None:
        inside = builder.apply("max", index, builder.constant(0, index.type))
        inside = builder.apply("min", inside, builder.constant(last, index.type))
        computed = _computed(builder, values, inside)
        if computed is not None:
            return computed
    answer = values[-1]
    for k in reversed(range(last)):
        up_to_here = builder.apply("le", index, builder.constant(k, index.type))
        answer = builder.apply("select", up_to_here, values[k], answer)
    return answer


LONG = 16
"""Arrays with more elements are read from memory, where they are inputs; others by a chain of choices."""


def _computed(builder: Builder, values: list[Value], index: Value) -> Value | None:
    """By arithmetic if the elements are a progression, else from memory if they lie there evenly."""
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
    """Start and step, if the elements are evenly spaced integers, as those of `arange` are."""
    if len(values) < 2 or any(value.op != "const" or value.type not in ("i64", "i32") for value in values):
        return None
    numbers = [int(value.data) for value in values]
    step = numbers[1] - numbers[0]
    even = all(later - sooner == step for sooner, later in itertools.pairwise(numbers))
    return (numbers[0], step) if even else None
