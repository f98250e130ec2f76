"""A program, or some of its values, as the statements of a C function."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass

from ..ir import Call, Program, Value
from ..naming import Names
from .blocks import BlockWriter
from .calls import Callees
from .dialect import Dialect
from .helpers import Helpers
from .layout import declared_together, laid_out
from .placement import Placement
from .rerolled import rerolled
from .scopes import scoped, stack
from .writer import Read, Rows

PLACED = frozenset({"const", "input", "param", "result"})
"""Values that lie somewhere already."""


@dataclass(frozen=True)
class Statements:
    """The inside of a C function.

    - `lines`: of C, indented.
    - `helpers`: the small functions that it calls.
    - `reads`: the numbers of the inputs that it reads.
    - `called`: the functions that it calls, each as often as it does.
    - `bytes`: what its variables take if each of a block has a place of its own; a compiler needs less.
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
    given: Mapping[Value, str] | None = None,
    names: Names | None = None,
    rows: Rows | None = None,
    callees: Callees | None = None,
    loops: bool = False,
    taken: Collection[str] = (),
) -> Statements:
    """Statements that compute values and assign them, and no more than they need.

    All assignments come last and at once: where an input is read from the very place that an output is written to, the
    old number is read.

    - `program`: that the values belong to.
    - `assigned`: where each value is written, as a C lvalue, and the value.
    - `read`: how an element of an input is read.
    - `dialect`: C99 with doubles if None.
    - `given`: values that are known already, and how they are read.
    - `names`: preferred names of values; None: as the source calls them.
    - `rows`: where logged outputs are written; None leaves them out.
    - `callees`: how functions are called; None where there is none.
    - `loops`: whether statements that are alike for all elements of an array become a loop.
    - `taken`: names that local variables must not have, such as those of the function's arguments.
    """
    given = given or {}
    stores = [value for value in program.walk() if value.op == "store"] if rows is not None else []
    placement = Placement(program, [*(value for _, value in assigned), *stores], given)
    writer = BlockWriter(placement, dialect or Dialect(), read, given, names or Names(program), set(taken))
    writer.rows = rows
    writer.callees = callees
    writer.loops = loops
    writer.expressions.alike = loops
    if loops:
        # An element of two arrays lies in the longer one.
        for which, array in sorted(enumerate(program.arrays), key=lambda pair: -len(pair[1])):
            for k, value in enumerate(array):
                if value.op not in ("const", "input") and value not in given:
                    writer.together.setdefault(value, (which, k))
        for number, array in enumerate(_arguments(program), start=len(program.arrays)):
            if all(value.op not in PLACED and value not in given and value not in writer.together for value in array):
                writer.together |= {value: (number, k) for k, value in enumerate(array)}
    writer.region(program.body)
    if writer.lines and assigned:
        writer.line("")
    writer.assign(assigned)
    lines = scoped(rerolled(writer.lines, writer.taken, writer.helpers)) if loops else writer.lines
    texts = laid_out(declared_together(lines) if loops else lines)
    return Statements(texts, writer.helpers, frozenset(writer.reads), stack(lines), writer.called)


def _arguments(program: Program) -> Iterator[tuple[Value, ...]]:
    """The arrays that calls are given."""
    for call in program.walk():
        if isinstance(call, Call):
            place = 0
            for entry in call.program.inputs:
                if entry.shape:
                    yield call.args[place : place + entry.size]
                place += entry.size
