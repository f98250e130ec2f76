"""A program as a function of NumPy arrays."""

from __future__ import annotations

import ctypes
import hashlib
import itertools
import os
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np

from slidax._errors import DefinitionError
from slidax.codegen.digest import digest
from slidax.codegen.fold import DTYPES
from slidax.codegen.ir import Program
from slidax.codegen.no_native_code import in_one_line

from . import machine
from .module import module
from .prepare import prepared

Arrays = list[np.ndarray]

LANES = 8
"""As many runs side by side as go best through the vector units."""

CHUNKS = 8
"""Pieces of a batch for each thread: so many that none waits long for the last."""


class Kernel:
    """A compiled program.

    - `program`: what it computes.
    - `lanes`: as many runs are computed side by side in vectors.
    - `quick`: whether the code is made in a fraction of the time, and takes 2 to 5 times as long for the same bits.
    - `known`: the program's `identity`, if it is known.
    """

    def __init__(self, program: Program, lanes: int, *, quick: bool = False, known: str | None = None) -> None:
        self.lanes, self.quick = lanes, quick
        self.inputs, self.outputs = program.inputs, program.outputs
        self.program = program
        with in_one_line(lambda: "the program"):
            what = (known or identity(program, lanes)) + " quick" * quick
            # A name of its own: code of another program does not have it.
            self._entry = f"runs_{hashlib.sha256(what.encode()).hexdigest()[:32]}"
            level = machine.QUICK if quick else machine.OPTIMISED
            self._code = machine.host().code_of(what, self._entry, lambda: self.text, level)
        signature = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_int64, ctypes.c_int64)
        self._run: Any = signature(self._code.address)

    @property
    def function(self) -> Any:
        """The code itself, called with the address of a table, the number of its lines, and how many rows are logged.

        A line of the table holds the addresses of all inputs and then of all outputs. Nothing is checked.
        """
        return self._run

    @property
    def object(self) -> bytes:
        """The code as an object file, for another process on this machine."""
        return self._code.object

    @property
    def entry(self) -> str:
        """What its function is called there."""
        return self._code.entry

    @property
    def text(self) -> str:
        """LLVM's text of it."""
        ready = prepared(self.program, self.lanes, quick=self.quick)
        return module(ready, self.lanes, self._entry, own=self.quick)

    def __call__(self, inputs: Sequence[Any], rows: int = 0) -> Arrays:
        """One run; returns its outputs.

        - `inputs`: of the shapes and dtypes that the program says.
        - `rows`: of each logged output, which has them as its first axis; those that are not written are 0.

        Raises DefinitionError if an input has another shape or dtype.
        """
        if self.lanes > 1:
            spread = [
                np.asarray(array)[None] if entry.varying else array
                for array, entry in zip(inputs, self.inputs, strict=True)
            ]
            return [array[0] for array in self.batch(spread, 1, rows, threads=1)]
        given = self._checked(inputs, None)
        outputs = self._empty(None, rows)
        table = np.array([array.ctypes.data for array in (*given, *outputs)], np.uintp)
        self._run(table.ctypes.data, 1, rows)
        return outputs

    def batch(self, inputs: Sequence[Any], runs: int, rows: int = 0, threads: int | None = None) -> Arrays:
        """Many runs; returns their outputs, with a first axis for the runs.

        - `inputs`: of the shapes and dtypes that the program says; those that vary have a first axis for the runs.
        - `runs`: how many, > 0.
        - `rows`: of each logged output, as its second axis; those that are not written are 0.
        - `threads`: as many share the runs; None: one for each processor. They change nothing in the numbers.

        Raises DefinitionError if an input has another shape or dtype.
        """
        given = self._checked(inputs, runs)
        outputs = self._empty(runs, rows)
        whole = runs // self.lanes
        table = self._table(given, outputs, whole)
        # The last group is filled up by repeating the last run, in arrays of its own.
        filled: Arrays = []
        if runs > whole * self.lanes:
            chosen = np.minimum(np.arange(whole * self.lanes, (whole + 1) * self.lanes), runs - 1)
            last = [array[chosen] if entry.varying else array for array, entry in zip(given, self.inputs, strict=True)]
            filled = self._empty(self.lanes, rows)
            table = np.concatenate([table, self._table(last, filled, 1)])
        self._share(table, rows, threads or _processors())
        for array, extra in zip(outputs, filled, strict=bool(filled)):
            array[whole * self.lanes :] = extra[: runs - whole * self.lanes]
        return outputs

    # ---- inside -----------------------------------------------------------------------------------------------------

    def _checked(self, inputs: Sequence[Any], runs: int | None) -> Arrays:
        if len(inputs) != len(self.inputs):
            raise DefinitionError(f"the program has {len(self.inputs)} inputs; got {len(inputs)}")
        arrays = []
        for array, entry in zip(inputs, self.inputs, strict=True):
            array = np.asarray(array)
            shape = (runs, *entry.shape) if entry.varying and runs is not None else entry.shape
            dtype = np.dtype(DTYPES[entry.type])
            if array.shape != shape or array.dtype != dtype:
                raise DefinitionError(
                    f"input `{entry.name}` must be {dtype} of shape {list(shape)}; "
                    f"got {array.dtype} of shape {list(array.shape)}"
                )
            arrays.append(np.ascontiguousarray(array))
        return arrays

    def _empty(self, runs: int | None, rows: int) -> Arrays:
        first = () if runs is None else (runs,)
        return [
            np.empty((*first, *output.shape), DTYPES[output.type])
            if output.values is not None
            else np.zeros((*first, rows, *output.shape), DTYPES[output.type])
            for output in self.outputs
        ]

    def _table(self, inputs: Arrays, outputs: Arrays, groups: int) -> Any:
        """The addresses of all arrays, for each group."""
        first = np.array([array.ctypes.data for array in (*inputs, *outputs)], np.uintp)
        steps = [array[0].nbytes if entry.varying else 0 for array, entry in zip(inputs, self.inputs, strict=True)]
        steps += [array[0].nbytes for array in outputs]
        return first + np.arange(groups, dtype=np.uintp)[:, None] * (np.array(steps, np.uintp) * np.uintp(self.lanes))

    def _share(self, table: Any, rows: int, threads: int) -> None:
        def run(piece: slice) -> None:
            part = table[piece]
            self._run(part.ctypes.data, len(part), rows)

        pieces = list(_pieces(len(table), 1 if threads == 1 else threads * CHUNKS))
        if len(pieces) == 1:
            run(pieces[0])
            return
        with ThreadPoolExecutor(threads) as pool:
            list(pool.map(run, pieces))


def _pieces(groups: int, pieces: int) -> Iterator[slice]:
    ends = np.linspace(0, groups, min(groups, pieces) + 1).astype(int)
    for first, end in itertools.pairwise(ends):
        yield slice(int(first), int(end))


def _processors() -> int:
    """Those that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def identity(program: Program, lanes: int) -> str:
    """All that the code of a program depends on, but for the machine.

    - `program`, `lanes`: as for `Kernel`.
    """
    return f"{digest(program)} {lanes}"


def compile(program: Program, lanes: int = 1) -> Kernel:
    """Machine code for a program.

    - `program`: stays as it is.
    - `lanes`: as many runs are computed side by side in vectors, a power of two; 1: no vectors. A run's numbers do not
      depend on it.

    Raises DefinitionError if llvmlite is missing, or the program asks for what there is no code for.
    """
    return Kernel(program, lanes)
