"""Generate the source of a CUDA kernel: each thread computes one run of a batch."""

from __future__ import annotations

from ..c.expressions import Dialect, Real
from ..c.functions import statements
from ..ir import Input, Output, Program
from ..naming.names import identifier

NAME = "run_all"


def cuda_code(program: Program, *, real: Real = "double") -> str:
    """Generate `run_all(inputs..., outputs..., runs)`, in which each thread computes one run.

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
