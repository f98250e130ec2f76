"""A program as a C file of one function."""

from __future__ import annotations

from ..ir import Program
from .dialect import Dialect, Real
from .statements import statements


def function(program: Program, name: str = "run", *, real: Real = "double") -> str:
    """Return the C99 text of `void run(const double *x0, ..., double *y0, ...)`, which needs `math.h` alone.

    The inputs are `x0`, `x1`, ... and the outputs `y0`, `y1`, ..., each an array in C order.

    - `program`: without logged outputs.
    - `real`: C type of f64.
    """
    dialect = Dialect(real)
    inputs = [f"x{k}" for k in range(len(program.inputs))]
    outputs = [f"y{k}" for k in range(len(program.outputs))]
    assigned = [
        (f"{array}[{element}]", value)
        for array, output in zip(outputs, program.outputs, strict=True)
        for element, value in enumerate(output.values or ())
    ]

    def read(k: int, element: int | str) -> str:
        return f"{inputs[k]}[{element}]"

    body = statements(program, assigned, read, dialect=dialect, taken={*inputs, *outputs, name})
    arguments = [f"const {dialect.type(e.type)} *{array}" for array, e in zip(inputs, program.inputs, strict=True)]
    arguments += [f"{dialect.type(e.type)} *{array}" for array, e in zip(outputs, program.outputs, strict=True)]
    return "\n".join(
        [
            *("#include <math.h>", "#include <stdbool.h>", "#include <stdint.h>", ""),
            *body.helpers.lines,
            f"void {name}({', '.join(arguments)});",
            f"void {name}({', '.join(arguments)})\n{{",
            *(f"    (void){array};" for k, array in enumerate(inputs) if k not in body.reads),
            *body.lines,
            "}\n",
        ]
    )
