"""Print programs of the intermediate representation as C functions."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass

from ..ir import PLACED, Call, Program, Value
from ..naming.names import Names
from .expressions import Dialect, Helpers, Real
from .layout import add_scopes, format_lines, join_declarations, stack_bytes
from .placement import Placement
from .rerolling import reroll
from .writer import Callees, Read, Rows, Writer


@dataclass(frozen=True)
class Statements:
    """Generated body of a C function.

    - `lines`: indented lines of C.
    - `helpers`: small functions that it calls.
    - `reads`: indices of the inputs that it reads.
    - `bytes`: stack size of its variables [bytes], by `layout.stack_bytes`.
    - `called`: the called programs, in the order of the calls.
    """

    lines: list[str]
    helpers: Helpers
    reads: frozenset[int]
    bytes: int
    called: list[Program]


def statements(
    program: Program,
    assigned: Sequence[tuple[str, Value]],
    read: Read,
    *,
    dialect: Dialect | None = None,
    precomputed: Mapping[Value, str] | None = None,
    names: Names | None = None,
    rows: Rows | None = None,
    callees: Callees | None = None,
    loops: bool = False,
    taken: Collection[str] = (),
) -> Statements:
    """Return the body of a C function that computes some values of a program and assigns them to variables.

    All assignments come last and take effect together: an input that shares memory with an output is read before it is
    overwritten.

    - `assigned`: pairs of a C lvalue and the value that it gets.
    - `read`: function from the indices of an input and of its element to the C text that reads the element.
    - `dialect`: C99 with doubles if None.
    - `precomputed`: values that need no computation, and the C text that reads them.
    - `names`: preferred names of values; None: names from the Python source.
    - `rows`: function from output, row and element of a log to the element's C lvalue; None omits the logs.
    - `callees`: function from a called program to its C function; None if the program has no calls.
    - `loops`: true to write similar statements for all elements of an array as a loop.
    - `taken`: names in use, such as those of the function's arguments.
    """
    precomputed = precomputed or {}
    stores = [value for value in program.walk() if value.op == "store"] if rows is not None else []
    placement = Placement(program, [*(value for _, value in assigned), *stores], precomputed)
    names = names or Names(program)
    writer = Writer(placement, dialect or Dialect(), read, precomputed, names, set(taken), rows, callees, loops)
    if loops:
        # An element of two arrays is placed in the longer one.
        for which, array in sorted(enumerate(program.arrays), key=lambda pair: -len(pair[1])):
            for k, value in enumerate(array):
                if value.op not in ("const", "input") and value not in precomputed:
                    writer.array_elements.setdefault(value, (which, k))
        for number, array in enumerate(_arguments(program), start=len(program.arrays)):
            if all(
                value.op not in PLACED and value not in precomputed and value not in writer.array_elements
                for value in array
            ):
                writer.array_elements |= {value: (number, k) for k, value in enumerate(array)}
    writer.region(program.body)
    if writer.lines and assigned:
        writer.line("")
    writer.assign(assigned)
    lines = add_scopes(reroll(writer.lines, writer.taken, writer.helpers)) if loops else writer.lines
    texts = format_lines(join_declarations(lines) if loops else lines)
    return Statements(texts, writer.helpers, frozenset(writer.reads), stack_bytes(lines), writer.called)


def _arguments(program: Program) -> Iterator[tuple[Value, ...]]:
    """Yield the arrays that are arguments of calls."""
    for call in program.walk():
        if isinstance(call, Call):
            start = 0
            for entry in call.program.inputs:
                if entry.shape:
                    yield call.args[start : start + entry.size]
                start += entry.size


def c_code(program: Program, name: str = "run", *, real: Real = "double") -> str:
    """Return the C99 text of `void run(const double *x0, ..., double *y0, ...)`, which needs only standard headers.

    The inputs are `x0`, `x1`, ... and the outputs `y0`, `y1`, ..., each an array in C order.

    - `program`: a program without logs or calls.
    - `name`: name of the function.
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
