"""C source of a step's functions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from slidax.codegen.c import Dialect, Helpers, loop_invariant, statements
from slidax.codegen.ir import Value
from slidax.codegen.naming import Names
from slidax.codegen.naming.names import suffix

from .functions import TYPES, Library, Members, Shared, unused
from .in_floats import in_floats
from .members import Member
from .programs import Function, Step


@dataclass(frozen=True)
class Body:
    """Body of a C function.

    - `lines`: of C, indented, including those that silence warnings about unused arguments.
    - `bytes`: stack of its variables, each in a place of its own.
    """

    lines: list[str]
    bytes: int


@dataclass(frozen=True)
class Source:
    """All functions of a step.

    - `checked`, `begun`, `held`, `valid`, `derived`, `answered`: the bodies.
    - `functions`: those that the law calls, each after those that it calls itself.
    - `workspace`: members for values that depend on the parameters alone.
    - `helpers`: lines of the small functions that they call.
    - `bytes`: upper bound of a step's stack: each variable of a block in a place of its own; consecutive blocks and
      functions share places.
    """

    checked: Body
    begun: Body
    held: Body
    valid: Body
    derived: Body
    answered: Body
    functions: list[Shared]
    workspace: list[Member]
    helpers: list[str]
    bytes: int


CALLS = {"double": 640, "float": 512}
"""Stack for calls [bytes]: return addresses, saved registers, arguments, intermediate results."""

SPILLED = 1.4
"""Stack of a compiler that unrolls loops, relative to that of the variables."""

TAKEN = ("checked", "begun", "held", "within", "related", "derived", "kept_up", "answered")
"""Functions of the file that are not the law's."""


def source(step: Step, dialect: Dialect) -> Source:
    """Write the functions of a step in C."""
    helpers = Helpers(dialect)
    sample = ("parameters", "measurement", "reference")
    if dialect.real == "float":
        step = replace(step, begun=_fitted(step.begun), answered=_fitted(step.answered))
    answered = step.answered
    library, members = Library((answered, step.begun), (*TAKEN, *TYPES)), Members()
    names = Names(answered.program, _outputs(answered))
    parameters = {k for k, place in enumerate(answered.inputs) if place.pointer == "parameters->"}
    kept = members.add(loop_invariant(answered.program, parameters), names)
    library.write(dialect, helpers, members)
    checked = body(step.checked, dialect, sample, helpers)
    begun = body(step.begun, dialect, (*sample, "workspace", "memory"), helpers, library)
    held = body(step.held, dialect, ("parameters", "memory"), helpers)
    valid = body(step.valid, dialect, ("parameters",), helpers)
    into = [(text, value) for value, text in kept.items()]
    derived = _body(answered, into, dialect, ("parameters", "workspace"), helpers, names, {}, library)
    arguments = (*sample, "workspace", "memory", "command")
    inside = _body(answered, answered.assigned, dialect, arguments, helpers, names, kept, library)
    # They run one after the other; only `derived` calls others.
    deriving = derived.bytes + max((each.derived_bytes for each in library.shared), default=0)
    total = (
        round(SPILLED * max(checked.bytes, held.bytes, valid.bytes, begun.bytes, deriving, inside.bytes))
        + CALLS[dialect.real]
    )
    lines = [*derived.lines, *(line for each in library.shared for line in each.derived)]
    return Source(
        checked=checked,
        begun=begun,
        held=held,
        valid=valid,
        derived=derived,
        answered=inside,
        functions=library.shared,
        workspace=[replace(member, meaning=_written(member.name, lines)) for member in members.all],
        helpers=helpers.lines,
        bytes=-(-total // 64) * 64,
    )


def body(
    function: Function, dialect: Dialect, arguments: Sequence[str], helpers: Helpers, library: Library | None = None
) -> Body:
    """Write the body of a function.

    - `arguments`: names of the C function's arguments.
    - `helpers`: collects the small functions that it calls.
    - `library`: the shared functions that it calls.
    """
    names = Names(function.program, _outputs(function))
    return _body(function, function.assigned, dialect, arguments, helpers, names, {}, library)


def _body(
    function: Function,
    assigned: list[tuple[str, Value]],
    dialect: Dialect,
    arguments: Sequence[str],
    helpers: Helpers,
    names: Names,
    kept: dict[Value, str],
    library: Library | None,
) -> Body:
    local = [place.member.name for place in function.outputs if not place.pointer]
    called = [] if library is None else [shared.name for shared in library.shared]
    written = statements(
        function.program,
        assigned,
        function.read,
        dialect=dialect,
        precomputed=kept,
        names=names,
        callees=None if library is None else library.callee,
        loops=True,
        taken=(*arguments, *local, *called, *TYPES, *TAKEN),
    )
    helpers.extend(written.helpers)
    deepest = 0 if library is None else library.deepest(written.called)
    return Body(unused(written.lines, arguments), written.bytes + deepest)


def _fitted(function: Function) -> Function:
    return replace(function, program=in_floats(function.program))


def _outputs(function: Function) -> dict[Value, str]:
    """Names for the values of signals, so that they can be recognised in the code."""
    return {
        value: place.member.name + suffix(k, place.member.shape)
        for place, output in zip(function.outputs, function.program.outputs, strict=True)
        if place.pointer == "command->"
        for k, value in enumerate(output.values or ())
        if value.op not in ("const", "input")
    }


def _written(name: str, lines: list[str]) -> str:
    """The expression that computes a member of the workspace."""
    start = f"    workspace->{name} = "
    return next((line.removeprefix(start).rstrip(";") for line in lines if line.startswith(start)), "")
