"""Run a program on an NVIDIA GPU, as a function of NumPy arrays."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from slidax._errors import DefinitionError

from ..c.dialect import Real
from ..ir import Program
from .arrays import Arrays, dtype_on_card, pack_inputs, unpack_outputs
from .kernel import NAME, kernel

THREADS = 128
"""Threads per block: few, as a controller needs many registers."""

OPTIONS = ("--std=c++17", "--fmad=false")
"""NVRTC options: products and sums are fused only where the program fuses them, as on the CPU."""


class Kernel:
    """A program compiled for the GPU.

    - `real`: the type of f64 on the GPU; NumPy arrays remain f64.

    Raises DefinitionError if CuPy or a GPU is missing.
    """

    def __init__(self, program: Program, real: Real = "double") -> None:
        self.program = program
        self.real = real
        self.text = kernel(program, real=real)
        self._cupy = _cupy()
        self._run: Any = self._cupy.RawModule(code=self.text, options=OPTIONS).get_function(NAME)

    def batch(self, inputs: Sequence[Any], runs: int, rows: int = 0) -> Arrays:
        """Compute many runs, and return the outputs with a first axis for the runs.

        - `inputs`: in the program's shapes and dtypes; those that vary have a first axis for the runs.
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


def compile(program: Program, real: Real = "double") -> Kernel:
    """Compile a program for the GPU with NVRTC, which needs no CUDA toolkit.

    - `real`: the type of f64 on the GPU.

    Raises DefinitionError if CuPy or a GPU is missing.
    """
    return Kernel(program, real)


def available() -> bool:
    """True if CuPy is installed and a GPU can be used."""
    try:
        require_card()
    except DefinitionError:
        return False
    return True


def require_card() -> None:
    """Raise DefinitionError, with the remedy, if CuPy or a GPU is missing."""
    _cupy()


def _cupy() -> Any:
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
