"""Array layout on the GPU: element by element, with the runs of a batch contiguous."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from slidax._errors import DefinitionError

from ..c.dialect import Real
from ..fold import DTYPES
from ..ir import FLOATS, Program, Type

Arrays = list[np.ndarray]


def pack_inputs(program: Program, inputs: Sequence[Any], runs: int, real: Real) -> Arrays:
    """Arrange inputs as the kernel reads them.

    - `inputs`: in the program's shapes and dtypes; those that vary have a first axis for the runs.
    - `real`: the type of f64 on the GPU.

    Raises DefinitionError if an input has another shape or dtype.
    """
    if len(inputs) != len(program.inputs):
        raise DefinitionError(f"the program has {len(program.inputs)} inputs; got {len(inputs)}")
    arrays = []
    for array, entry in zip(map(np.asarray, inputs), program.inputs, strict=True):
        shape = (runs, *entry.shape) if entry.varying else entry.shape
        dtype = np.dtype(DTYPES[entry.type])
        if array.shape != shape or array.dtype != dtype:
            raise DefinitionError(
                f"input `{entry.name}` must be {dtype} of shape {list(shape)}; "
                f"got {array.dtype} of shape {list(array.shape)}"
            )
        flat = array.reshape(runs, entry.size).T if entry.varying else array.reshape(entry.size)
        arrays.append(np.ascontiguousarray(flat, dtype_on_card(entry.type, real)))
    return arrays


def unpack_outputs(program: Program, outputs: Arrays) -> Arrays:
    """Arrange the kernel's outputs with runs first and rows second, in the program's dtypes.

    - `outputs`: shape [rows size runs], with one row if they are not logged.
    """
    results = []
    for array, entry in zip(outputs, program.outputs, strict=True):
        runs_first = np.moveaxis(array, 2, 0)
        rows = runs_first.shape[:1] if entry.values is not None else runs_first.shape[:2]
        results.append(np.ascontiguousarray(runs_first.reshape(*rows, *entry.shape), DTYPES[entry.type]))
    return results


def dtype_on_card(type: Type, real: Real) -> Any:
    """NumPy dtype on the GPU of a type in the program, where `real` is the type of f64 on the GPU."""
    return np.float32 if type in FLOATS and real == "float" else DTYPES[type]
