"""Run a program on an NVIDIA card as a function of NumPy arrays."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from slidax.core.errors import DefinitionError

from ..c.expressions import Real
from ..ir import DTYPES, FLOATS, Program, Type, checked_inputs
from .source import NAME, cuda_code

Arrays = list[np.ndarray]


def pack_inputs(program: Program, inputs: Sequence[Any], runs: int, real: Real) -> Arrays:
    """Arrange inputs as the kernel reads them.

    - `inputs`: arrays in the program's shapes and dtypes; those that vary have a first axis for the runs.
    - `real`: the type of f64 on the GPU.

    Raises DefinitionError if an input has another shape or dtype.
    """
    arrays = []
    for array, entry in zip(checked_inputs(program, inputs, runs), program.inputs, strict=True):
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


THREADS = 128
"""Threads per block: few, since a controller needs many registers."""

OPTIONS = ("--std=c++17", "--fmad=false")
"""NVRTC options: products and sums are fused only if the program fuses them, as on the CPU."""


class CudaKernel:
    """A program compiled for the GPU with NVRTC, which needs no CUDA toolkit.

    - `real`: the type of f64 on the GPU; NumPy arrays remain f64.

    Raises DefinitionError if CuPy or a GPU is missing.
    """

    def __init__(self, program: Program, real: Real = "double") -> None:
        self.program = program
        self.real = real
        self.text = cuda_code(program, real=real)
        self._cupy = require_card()
        self._run: Any = self._cupy.RawModule(code=self.text, options=OPTIONS).get_function(NAME)

    def batch(self, inputs: Sequence[Any], runs: int, rows: int = 0) -> Arrays:
        """Compute many runs, and return the outputs with a first axis for the runs.

        - `inputs`: inputs in the program's shapes and dtypes; those that vary have a first axis for the runs.
        - `runs`: number of runs, > 0.
        - `rows`: number of rows of each logged output, its second axis; rows that are not written are 0.

        Raises DefinitionError if an input has another shape or dtype.
        """
        cp = self._cupy
        arguments = [cp.asarray(array) for array in pack_inputs(self.program, inputs, runs, self.real)]
        outputs = [
            cp.zeros((rows if entry.values is None else 1, entry.size, runs), dtype_on_card(entry.type, self.real))
            for entry in self.program.outputs
        ]
        self._run((-(-runs // THREADS),), (THREADS,), (*arguments, *outputs, np.int64(runs)))
        return unpack_outputs(self.program, [cp.asnumpy(array) for array in outputs])


def card_available() -> bool:
    """True if CuPy is installed and a GPU can be used."""
    try:
        require_card()
    except DefinitionError:
        return False
    return True


def require_card() -> Any:
    """Return CuPy; raise DefinitionError, with the remedy, if it or a GPU is missing."""
    try:
        import cupy
    except ImportError:
        raise DefinitionError('GPU runs need CuPy, which is not installed: run `pip install "slidax[cuda]"`') from None
    try:
        count = cupy.cuda.runtime.getDeviceCount()
    except cupy.cuda.runtime.CUDARuntimeError as error:
        raise DefinitionError(f"no usable NVIDIA GPU ({error}): install its driver, or compute on the CPU") from None
    if count == 0:
        raise DefinitionError("no NVIDIA GPU: compute on the CPU")
    return cupy
