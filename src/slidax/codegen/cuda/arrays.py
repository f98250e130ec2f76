"""How arrays lie on the card: element by element, in each the runs of the batch side by side."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from slidax._errors import DefinitionError

from ..c.dialect import Real
from ..fold import DTYPES
from ..ir import FLOATS, Program, Type

Arrays = list[np.ndarray]


def laid_out(program: Program, inputs: Sequence[Any], runs: int, real: Real) -> Arrays:
    """Inputs as the kernel reads them.

    - `program`: that reads them.
    - `inputs`: of the shapes and dtypes that the program says; those that vary have a first axis for the runs.
    - `runs`: how many.
    - `real`: the type of f64 on the card.

    Raises DefinitionError if one has another shape or dtype.
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


def collected(program: Program, outputs: Arrays) -> Arrays:
    """Outputs as the kernel wrote them, with the runs first and rows second, in the program's own dtypes.

    - `program`: that wrote them.
    - `outputs`: of shape [rows size runs], with one row if they are not logged.
    """
    results = []
    for array, entry in zip(outputs, program.outputs, strict=True):
        runs_first = np.moveaxis(array, 2, 0)
        rows = runs_first.shape[:1] if entry.values is not None else runs_first.shape[:2]
        results.append(np.ascontiguousarray(runs_first.reshape(*rows, *entry.shape), DTYPES[entry.type]))
    return results


def dtype_on_card(type: Type, real: Real) -> Any:
    """NumPy's name of a type on the card.

    - `type`: in the program.
    - `real`: the type of f64 on the card.
    """
    return np.float32 if type in FLOATS and real == "float" else DTYPES[type]
