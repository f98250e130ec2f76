"""Conversion between arrays and the flat lists of values that blocks carry."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from slidax.codegen.builder import Values
from slidax.codegen.ir import Value

from .arrays import value_array


def packed(arrays: Sequence[Values]) -> list[Value]:
    """Return the elements of arrays, one array after the other, each in C order."""
    return [value for array in arrays for value in array.ravel()]


def unpacked(values: Sequence[Value], shapes: Sequence[tuple[int, ...]]) -> list[Values]:
    """Return the arrays with these shapes, from values as `packed` gives them."""
    arrays, place = [], 0
    for shape in shapes:
        size = int(np.prod(shape, dtype=int))
        arrays.append(value_array(values[place : place + size], shape))
        place += size
    return arrays
