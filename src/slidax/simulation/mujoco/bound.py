"""Machine code that is called again and again on the same memory."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from slidax.codegen import llvm
from slidax.codegen.fold import DTYPES


class Bound:
    """A kernel, with the arrays that it reads and writes: each call takes the numbers that are in them then.

    A call costs less than a microsecond, where handing over arrays one by one costs twenty.

    - `kernel`: of one run.
    - `inputs`, `outputs`: as it says, one memory block each; no output may be an input.
    """

    def __init__(self, kernel: llvm.Kernel, inputs: Sequence[np.ndarray], outputs: Sequence[np.ndarray]) -> None:
        for array, entry in zip(inputs, kernel.inputs, strict=True):
            assert array.shape == entry.shape
            assert array.dtype == DTYPES[entry.type]
            assert array.flags.c_contiguous
        # Held: the kernel knows their addresses alone.
        self._arrays = [*inputs, *outputs]
        self._inputs = len(inputs)
        self._table = np.array([array.ctypes.data for array in self._arrays], np.uintp)
        self._address = self._table.ctypes.data
        self._run = kernel.function

    def __call__(self) -> None:
        """Computes the outputs."""
        self._run(self._address, 1, 0)

    def shift(self, outputs: slice, by: np.ndarray) -> None:
        """Lets it write outputs elsewhere from now on.

        - `outputs`: which.
        - `by`: how many bytes further, for each of them.
        """
        self._table[self._inputs :][outputs] += by


def outputs_of(kernel: llvm.Kernel) -> list[np.ndarray]:
    """Arrays for all that a kernel writes.

    - `kernel`: of one run.
    """
    return [np.empty(output.shape, DTYPES[output.type]) for output in kernel.outputs]
