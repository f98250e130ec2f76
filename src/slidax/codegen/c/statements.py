"""A program, or some of its values, as the statements of a C function."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass

from ..ir import PLACED, Call, Program, Value
from ..naming import Names
from .dialect import Dialect
from .helpers import Helpers
from .layout import format_lines, join_declarations
from .placement import Placement
from .rerolled import reroll
from .scopes import add_scopes, stack_bytes
from .writer import Callees, Read, Rows, Writer


@dataclass(frozen=True)
class Statements:
    """Body of a C function.

    - `lines`: of C, indented.
    - `helpers`: small functions that it calls.
    - `reads`: numbers of the inputs that it reads.
    - `called`: functions that it calls, once for each call.
    - `bytes`: stack of its variables if all in a block have places of their own; a compiler needs less.
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
    """Return statements that compute and assign values, and nothing that these do not need.

    All assignments come last and take effect together: an input in the place of an output is read before it is
    overwritten.

    - `assigned`: C lvalues and their values.
    - `read`: C text that reads an element of an input.
    - `dialect`: C99 with doubles if None.
    - `precomputed`: values that need no computation, and the C text that reads them.
    - `names`: preferred names of values; None: names of the source.
    - `rows`: places of logged outputs; None omits these outputs.
    - `callees`: C functions of the called programs; None if there are none.
    - `loops`: true to write similar statements for all elements of an array as a loop.
    - `taken`: names in use, such as those of the function's arguments.
    """
    precomputed = precomputed or {}
    stores = [value for value in program.walk() if value.op == "store"] if rows is not None else []
    placement = Placement(program, [*(value for _, value in assigned), *stores], precomputed)
    writer = Writer(placement, dialect or Dialect(), read, precomputed, names or Names(program), set(taken))
    writer.rows = rows
    writer.callees = callees
    writer.loops = loops
    writer.expressions.ordered_operands = loops
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
    """Arrays that are arguments of calls."""
    for call in program.walk():
        if isinstance(call, Call):
            place = 0
            for entry in call.program.inputs:
                if entry.shape:
                    yield call.args[place : place + entry.size]
                place += entry.size
