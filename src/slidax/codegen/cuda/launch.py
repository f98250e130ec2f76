"""A program on an NVIDIA card, as a function of NumPy arrays."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from slidax._errors import DefinitionError

from ..c.dialect import Real
from ..ir import Program
from .arrays import Arrays, collected, dtype_on_card, laid_out
from .kernel import NAME, kernel

THREADS = 128
"""Of a block: few, as a law fills many registers."""

OPTIONS = ("--std=c++17", "--fmad=false")
"""Products and sums are fused where the program says so and nowhere else, as on the processor."""


class Kernel:
    """A program compiled for the card.

    - `program`: what it computes.
    - `real`: the type of its f64 on the card; arrays of f64 stay so outside.

    Raises DefinitionError if CuPy or a card is missing.
    """

    def __init__(self, program: Program, real: Real = "double") -> None:
        self.program = program
        self.real = real
        self.text = kernel(program, real=real)
        self._cupy = _cupy()
        self._run: Any = self._cupy.RawModule(code=self.text, options=OPTIONS).get_function(NAME)

    def batch(self, inputs: Sequence[Any], runs: int, rows: int = 0) -> Arrays:
        """Many runs; returns their outputs, with a first axis for the runs.

        - `inputs`: of the shapes and dtypes that the program says; those that vary have a first axis for the runs.
        - `runs`: how many, > 0.
        - `rows`: of each logged output, as its second axis; those that are not written are 0.

        Raises DefinitionError if an input has another shape or dtype.
        """
        cp = self._cupy
        given = [cp.asarray(array) for array in laid_out(self.program, inputs, runs, self.real)]
        left = [
            cp.zeros((rows if entry.values is None else 1, entry.size, runs), dtype_on_card(entry.type, self.real))
            for entry in self.program.outputs
        ]
        self._run((-(-runs // THREADS),), (THREADS,), (*given, *left, np.int64(runs)))
        return collected(self.program, [cp.asnumpy(array) for array in left])


def compile(program: Program, real: Real = "double") -> Kernel:
    """A program for the card, compiled by NVRTC; no CUDA toolkit is needed.

    - `program`: stays as it is.
    - `real`: the type of its f64 on the card.

    Raises DefinitionError if CuPy or a card is missing.
    """
    return Kernel(program, real)


def available() -> bool:
    """Whether there is CuPy, and a card."""
    try:
        require_card()
    except DefinitionError:
        return False
    return True


def require_card() -> None:
    """Raises DefinitionError, which says what to install, unless there is CuPy, and a card."""
    _cupy()


def _cupy() -> Any:
    try:
        import cupy
    except ImportError:
        raise DefinitionError(
            'runs on a card need CuPy, which is not installed: run `pip install "slidax[cuda]"`'
        ) from None
    try:
        count = cupy.cuda.runtime.getDeviceCount()
    except cupy.cuda.runtime.CUDARuntimeError as error:
        raise DefinitionError(
            f"no NVIDIA card can be used ({error}): install its driver, or compute on the CPU"
        ) from None
    if count == 0:
        raise DefinitionError("there is no NVIDIA card here: compute on the CPU")
    return cupy
