"""Between arrays and the flat numbers that blocks carry and leave."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from slidax.codegen.builder import Values
from slidax.codegen.ir import Value

from .arrays import of_list


def packed(arrays: Sequence[Values]) -> list[Value]:
    """The numbers of arrays, one after the other, each in C order.

    - `arrays`: of any shapes.
    """
    return [value for array in arrays for value in array.ravel()]


def unpacked(values: Sequence[Value], shapes: Sequence[tuple[int, ...]]) -> list[Values]:
    """The arrays with these numbers.

    - `values`: as `packed` gives them.
    - `shapes`: of the arrays.
    """
    arrays, place = [], 0
    for shape in shapes:
        size = int(np.prod(shape, dtype=int))
        arrays.append(of_list(values[place : place + size], shape))
        place += size
    return arrays
