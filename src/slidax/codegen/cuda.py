"""CUDA kernels of programs: each thread computes one run of a batch."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from slidax.core.errors import DefinitionError

from .c.expressions import Dialect, Real
from .c.functions import statements
from .ir import DTYPES, FLOATS, Input, Output, Program, Type, checked_inputs
from .naming.names import identifier

Arrays = list[np.ndarray]

NAME = "run_all"

THREADS = 128
"""Threads per block: few, since a controller needs many registers per thread."""

OPTIONS = ("--std=c++17", "--fmad=false")
"""NVRTC options: products and sums are fused only if the program fuses them, as on the CPU."""


def cuda_code(program: Program, *, real: Real = "double") -> str:
    """Return the CUDA source of a kernel `run_all(inputs..., outputs..., runs)`; each thread computes one run.

    The arrays of a batch are stored element by element, `x[element * runs + run]`, and a row of a log as
    `y[(row * size + element) * runs + run]`: neighbouring threads access neighbouring addresses. Inputs that do not
    vary are `x[element]`. The state of a time loop stays in registers.

    - `real`: the type of f64 on the GPU; "float" is up to 64 times as fast on consumer GPUs, with 7 digits.
    """
    names = _names(program)
    inputs, outputs = names[: len(program.inputs)], names[len(program.inputs) :]
    dialect = Dialect(real, kernel=True)

    def read(k: int, element: int | str) -> str:
        return f"{inputs[k]}[{_of_run(element) if program.inputs[k].varying else element}]"

    def row_of(k: int, row: str, element: int) -> str:
        size = program.outputs[k].size
        index = _factor(row) if size == 1 else f"({_factor(row)} * {size} + {element})"
        return f"{outputs[k]}[{index} * runs + run]"

    assigned = [
        (f"{outputs[k]}[{_of_run(element)}]", value)
        for k, output in enumerate(program.outputs)
        for element, value in enumerate(output.values or ())
    ]
    body = statements(program, assigned, read, dialect=dialect, rows=row_of, taken=(*names, "run", "runs", NAME))
    arguments = [
        f"const {dialect.type(entry.type)} *__restrict__ {name}"
        for name, entry in zip(inputs, program.inputs, strict=True)
    ]
    arguments += [
        f"{dialect.type(entry.type)} *__restrict__ {name}" for name, entry in zip(outputs, program.outputs, strict=True)
    ]
    return "\n".join(
        [
            *body.helpers.lines,
            f'extern "C" __global__ void {NAME}(',
            *[f"    {argument}," for argument in arguments],
            "    const long long runs)",
            "{",
            "    const long long run = (long long)blockIdx.x * blockDim.x + threadIdx.x;",
            "    if (run >= runs) {",
            "        return;",
            "    }",
            *[f"    (void){name};" for k, name in enumerate(inputs) if k not in body.reads],
            *body.lines,
            "}",
            "",
        ]
    )


def _names(program: Program) -> list[str]:
    """Return distinct names for the arguments."""
    names: list[str] = []
    entries: list[Input | Output] = [*program.inputs, *program.outputs]
    for entry in entries:
        name = identifier(entry.name)
        while name in names:
            name += "_out"
        names.append(name)
    return names


def _of_run(element: int | str) -> str:
    if element == 0:
        return "run"
    return "runs + run" if element == 1 else f"{_factor(element)} * runs + run"


def _factor(text: int | str) -> str:
    return str(text) if str(text).isidentifier() or str(text).isdigit() else f"({text})"


def pack_inputs(program: Program, inputs: Sequence[Any], runs: int, real: Real) -> Arrays:
    """Return inputs as the kernel stores them: [elements runs] if they vary between runs, else [elements].

    - `inputs`: arrays in the program's shapes and dtypes; those that vary have a first axis for the runs.
    - `real`: the type of f64 on the GPU.

    Raises DefinitionError if the number of inputs, a shape or a dtype differs from the program's.
    """
    arrays = []
    for array, entry in zip(checked_inputs(program, inputs, runs), program.inputs, strict=True):
        flat = array.reshape(runs, entry.size).T if entry.varying else array.reshape(entry.size)
        arrays.append(np.ascontiguousarray(flat, dtype_on_card(entry.type, real)))
    return arrays


def unpack_outputs(program: Program, outputs: Arrays) -> Arrays:
    """Return the kernel's outputs in the program's shapes and dtypes: first axis runs, second axis rows of a log.

    - `outputs`: the kernel's arrays [rows elements runs]. An output that is not a log has one row here, and no axis for
      rows in the result.
    """
    results = []
    for array, entry in zip(outputs, program.outputs, strict=True):
        runs_first = np.moveaxis(array, 2, 0)
        rows = runs_first.shape[:1] if entry.values is not None else runs_first.shape[:2]
        results.append(np.ascontiguousarray(runs_first.reshape(*rows, *entry.shape), DTYPES[entry.type]))
    return results


def dtype_on_card(type: Type, real: Real) -> Any:
    """Return the NumPy dtype that stores an IR type on the GPU, where `real` is the C type of f64."""
    return np.float32 if type in FLOATS and real == "float" else DTYPES[type]


class CudaKernel:
    """A program compiled for the GPU with NVRTC, which needs no CUDA toolkit.

    - `real`: the type of f64 on the GPU; inputs and outputs remain float64 in NumPy.

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
        - `rows`: number of rows of each log, its second axis; rows that are not written are 0.

        Raises DefinitionError if the number of inputs, a shape or a dtype differs from the program's.
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
    """Return CuPy; raise DefinitionError, with the remedy, if CuPy or a GPU is missing."""
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
