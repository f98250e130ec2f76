"""Compile a program to a function of NumPy arrays; choose the optimisation level by the expected use.

A run evaluates the program once. A batch is many runs with different inputs; a lane is one of the runs that the CPU's
vector instructions compute in parallel.
"""

from __future__ import annotations

import ctypes
import hashlib
import itertools
import os
import os.path
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np

from slidax.core.errors import DefinitionError

from ..ir import DTYPES, Program, as_native_code_error, checked_inputs, digest
from . import machine
from . import machine as cache
from .blocks import Blocks, ElementaryFunction
from .operations import type_name
from .vectorise import prepare


def module(program: Program, lanes: int = 1, entry: str = "runs") -> str:
    """Return the LLVM IR of a program that computes runs in groups of `lanes`.

    Its function is `void runs(ptr tables, i64 groups, i64 rows)`. `tables` contains, for each group in turn, the
    addresses of all inputs and then all outputs. `rows` is the number of rows of each log.

    - `program`: result of `prepare`.
    - `lanes`: number of runs that are computed in parallel, a power of two.
    - `entry`: name of the function.

    Raises DefinitionError for another number of lanes.
    """
    if lanes < 1 or lanes & (lanes - 1):
        raise DefinitionError(f"`lanes` must be a power of two; got {lanes}")
    blocks = Blocks(program, lanes)
    blocks.print()
    functions = [line for function in sorted(blocks.called, key=str) for line in _define(function, blocks.declarations)]
    addresses = len(program.inputs) + len(program.outputs)
    return "\n".join(
        [
            *sorted(blocks.declarations),
            *functions,
            "define internal void @group(ptr noalias readonly %table, i64 %rows) #0 {",
            "entry:",
            *blocks.lines,
            "}",
            f"define void @{entry}(ptr %tables, i64 %groups, i64 %rows) #0 {{",
            "entry:",
            "  br label %head",
            "head:",
            "  %k = phi i64 [ 0, %entry ], [ %next, %body ]",
            "  %more = icmp slt i64 %k, %groups",
            "  br i1 %more, label %body, label %after",
            "body:",
            f"  %at = mul i64 %k, {addresses}",
            "  %table = getelementptr ptr, ptr %tables, i64 %at",
            "  call void @group(ptr %table, i64 %rows)",
            "  %next = add i64 %k, 1",
            "  br label %head",
            "after:",
            "  ret void",
            "}",
            # Use the CPU's widest vectors, although some CPUs reduce their clock rate for them.
            'attributes #0 = { nounwind noinline "prefer-vector-width"="512" "min-legal-vector-width"="512" }',
            "!0 = !{}",
            "",
        ]
    )


def _define(function: ElementaryFunction, declarations: set[str]) -> list[str]:
    """Return the LLVM IR of an elementary function; add the functions that it calls to the declarations."""
    blocks = Blocks(function.program, function.width)
    llvm_type = type_name(function.type, function.width)
    blocks.print_function(llvm_type)
    declarations |= blocks.declarations
    arguments = ", ".join(f"{llvm_type} %x{k}" for k in range(function.arguments))
    return [f"define internal {function.head}({arguments}) #0 {{", "entry:", *blocks.lines, "}"]


Arrays = list[np.ndarray]

LANES = 8
"""Number of lanes for the best use of the vector units."""

CHUNKS = 8
"""Number of pieces of a batch per thread, so that no thread waits long for the last piece."""


class Kernel:
    """A program compiled to machine code, which is called with NumPy arrays.

    - `lanes`: number of runs that are computed in parallel.
    - `quick`: True for code that compiles in a fraction of the time, but runs 2 to 5 times slower, with equal results.
    - `known`: result of `identity` for the program, if it was computed before; saves time.

    Raises DefinitionError as `compile` does.
    """

    def __init__(self, program: Program, lanes: int, *, quick: bool = False, known: str | None = None) -> None:
        self.lanes, self.quick = lanes, quick
        self.inputs, self.outputs = program.inputs, program.outputs
        self.program = program
        with as_native_code_error(lambda: "the program"):
            source = (known or identity(program, lanes)) + " quick" * quick
            # The name is different for each program.
            self._entry = f"runs_{hashlib.sha256(source.encode()).hexdigest()[:32]}"
            level = machine.QUICK if quick else machine.OPTIMISED
            self._code = machine.host().code_of(source, self._entry, lambda: self.text, level)
        signature = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_int64, ctypes.c_int64)
        self._run: Any = signature(self._code.address)

    @property
    def function(self) -> Any:
        """The machine code as a ctypes function, `function(table, lines, rows)`, which checks no argument.

        `table` is the address of a table, and `lines` its number of lines, one per group of `lanes` runs. A line
        contains the addresses of all inputs and then of all outputs. `rows` is the number of rows of each log.
        """
        return self._run

    @property
    def object(self) -> bytes:
        """The code as an object file, for another process on this machine."""
        return self._code.object

    @property
    def entry(self) -> str:
        """Name of the function in the object file."""
        return self._code.entry

    @property
    def text(self) -> str:
        """LLVM IR of the program."""
        ready = prepare(self.program, self.lanes, quick=self.quick)
        return module(ready, self.lanes, self._entry)

    def __call__(self, inputs: Sequence[Any], rows: int = 0) -> Arrays:
        """Compute one run, and return its outputs.

        - `inputs`: inputs in the program's shapes and dtypes.
        - `rows`: number of rows of each log, its first axis; rows that are not written are 0.

        Raises DefinitionError if the number of inputs, a shape or a dtype differs from the program's.
        """
        if self.lanes > 1:
            checked = checked_inputs(self.program, inputs, None)
            spread = [own[None] if entry.varying else own for own, entry in zip(checked, self.inputs, strict=True)]
            return [array[0] for array in self.batch(spread, 1, rows, threads=1)]
        arrays = self._contiguous(inputs, None)
        outputs = self._empty(None, rows)
        table = np.array([array.ctypes.data for array in (*arrays, *outputs)], np.uintp)
        self._run(table.ctypes.data, 1, rows)
        return outputs

    def batch(self, inputs: Sequence[Any], runs: int, rows: int = 0, threads: int | None = None) -> Arrays:
        """Compute many runs, and return the outputs with a first axis for the runs.

        - `inputs`: inputs in the program's shapes and dtypes; those that vary have a first axis for the runs.
        - `runs`: number of runs, > 0.
        - `rows`: number of rows of each log, its second axis; rows that are not written are 0.
        - `threads`: number of threads; None: one per CPU core. The results do not depend on it.

        Raises DefinitionError if the number of inputs, a shape or a dtype differs from the program's.
        """
        arrays = self._contiguous(inputs, runs)
        outputs = self._empty(runs, rows)
        groups = runs // self.lanes
        in_groups = groups * self.lanes
        table = self._table(arrays, outputs, groups)
        # The last group repeats the last run in the remaining lanes, in separate arrays.
        filled: Arrays = []
        if runs > in_groups:
            chosen = np.minimum(np.arange(in_groups, in_groups + self.lanes), runs - 1)
            last = [array[chosen] if entry.varying else array for array, entry in zip(arrays, self.inputs, strict=True)]
            filled = self._empty(self.lanes, rows)
            table = np.concatenate([table, self._table(last, filled, 1)])
        self._share(table, rows, threads or _processors())
        for array, extra in zip(outputs, filled, strict=bool(filled)):
            array[in_groups:] = extra[: runs - in_groups]
        return outputs

    # ---- inside -----------------------------------------------------------------------------------------------------

    def _contiguous(self, inputs: Sequence[Any], runs: int | None) -> Arrays:
        return [np.ascontiguousarray(array) for array in checked_inputs(self.program, inputs, runs)]

    def _empty(self, runs: int | None, rows: int) -> Arrays:
        first = () if runs is None else (runs,)
        return [
            np.empty((*first, *output.shape), DTYPES[output.type])
            if output.values is not None
            else np.zeros((*first, rows, *output.shape), DTYPES[output.type])
            for output in self.outputs
        ]

    def _table(self, inputs: Arrays, outputs: Arrays, groups: int) -> Any:
        """Return the table with the addresses of all arrays, one line per group of runs."""
        first = np.array([array.ctypes.data for array in (*inputs, *outputs)], np.uintp)
        steps = [array[0].nbytes if entry.varying else 0 for array, entry in zip(inputs, self.inputs, strict=True)]
        steps += [array[0].nbytes for array in outputs]
        return first + np.arange(groups, dtype=np.uintp)[:, None] * (np.array(steps, np.uintp) * np.uintp(self.lanes))

    def _share(self, table: Any, rows: int, threads: int) -> None:
        def run(piece: slice) -> None:
            part = table[piece]
            self._run(part.ctypes.data, len(part), rows)

        ends = np.linspace(0, len(table), min(len(table), 1 if threads == 1 else threads * CHUNKS) + 1).astype(int)
        pieces = [slice(int(first), int(end)) for first, end in itertools.pairwise(ends)]
        if len(pieces) == 1:
            run(pieces[0])
            return
        with ThreadPoolExecutor(threads) as pool:
            list(pool.map(run, pieces))


def _processors() -> int:
    """Number of CPU cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def identity(program: Program, lanes: int) -> str:
    """Return a key for cached code, which is equal for equal programs with equal `lanes`.

    The key does not depend on the machine or on the optimisation level.
    """
    return f"{digest(program)} {lanes}"


def compile(program: Program, lanes: int = 1) -> Kernel:
    """Compile a program to machine code, without changing the program.

    - `lanes`: number of runs that are computed in parallel, a power of two. A run's results do not depend on it.

    Raises DefinitionError if llvmlite is missing, `lanes` is not a power of two, or an operation of the program has no
    code.
    """
    return Kernel(program, lanes)


WORTHWHILE_ITERATIONS = {1: 200_000, 8: 100_000}
"""Least number of loop iterations, by lanes, for which optimised code saves time.

For a loop with seven joints, optimised code takes 7 s longer to compile, and then saves 14 µs per iteration; with eight
lanes, 9 s and 70 µs. Both grow with the program, so the number of iterations does not depend on its size. The total
time is at most about twice that of the better choice.
"""

STACK_LIMIT = 2_500_000
"""Largest size of the values in quick code, in bytes. The values take about half of that on the stack. A thread's stack
has 8 MB, on Windows 2 MB."""

VALUE_SIZE = 8
"""Bytes of one value in one lane."""


class ByDemand:
    """Machine code of a program: compiled quickly at first, and with optimisation once the program runs long enough.

    The results of both are bitwise equal.

    - `program`: a program that spends its time in one loop.
    - `lanes`: number of runs that are computed in parallel.
    """

    def __init__(self, program: Program, lanes: int = 1) -> None:
        self.program, self.lanes = program, lanes
        self._iterations = 0
        self._identity: str | None = None
        self._kernel: Kernel | None = None

    def kernel(self, iterations: int) -> Kernel:
        """Return the code for the next run. It is optimised once the iterations of all calls add up to enough.

        The first call also returns optimised code if the cache has it, or if quick code might overflow the stack.

        - `iterations`: number of the loop's iterations in the next run. Runs that are computed in parallel count once.

        Raises DefinitionError if llvmlite is missing, or an operation of the program has no code.
        """
        first = self._kernel is None
        self._iterations += iterations
        worth = self._iterations >= WORTHWHILE_ITERATIONS.get(self.lanes, 0)
        if self._kernel is None or (worth and self._kernel.quick):
            with as_native_code_error(lambda: "the program"):
                self._identity = self._identity or identity(self.program, self.lanes)
            optimised = worth or (first and (self._is_cached(self._identity) or self._is_large()))
            self._kernel = Kernel(self.program, self.lanes, quick=not optimised, known=self._identity)
        return self._kernel

    def _is_cached(self, identity: str) -> bool:
        """True if the cache has optimised code."""
        key = machine.host().key_of(identity, machine.OPTIMISED)
        # Not `Path.is_file`, which raises where the folder is closed to this user.
        return os.path.isfile(cache.path_of(key))

    def _is_large(self) -> bool:
        """True if quick code might overflow the stack."""
        return sum(1 for _ in self.program.walk()) * VALUE_SIZE * self.lanes > STACK_LIMIT
