"""The functions of an exported step as text."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from slidax.codegen.c import Dialect, Helpers, loop_invariant, statements
from slidax.codegen.ir import Value
from slidax.codegen.naming import Names
from slidax.codegen.naming.names import suffix

from .in_floats import in_floats
from .members import Member
from .programs import Function, Step


@dataclass(frozen=True)
class Body:
    """The inside of a C function.

    - `lines`: of C, indented; those that keep a compiler from warning of unused arguments included.
    - `bytes`: what its variables take if each has a place of its own.
    """

    lines: list[str]
    bytes: int


@dataclass(frozen=True)
class Source:
    """All functions of a step.

    - `checked`, `begun`, `held`, `derived`, `answered`: the bodies.
    - `workspace`: members for what follows from the parameters alone.
    - `helpers`: the lines of the small functions that they call.
    - `bytes`: a bound of the stack that a step takes: all functions in line, each variable in a place of its own.
    """

    checked: Body
    begun: Body
    held: Body
    derived: Body
    answered: Body
    workspace: list[Member]
    helpers: list[str]
    bytes: int


CALLS = 512
"""Bytes for what calls keep: return addresses, saved registers, arguments, numbers between two operations."""


def source(step: Step, dialect: Dialect) -> Source:
    """The functions of a step.

    - `step`: their programs.
    - `dialect`: how types and numbers are written.
    """
    helpers = Helpers(dialect)
    sample = ("parameters", "measurement", "reference")
    if dialect.real == "float":
        step = replace(step, begun=_fitted(step.begun), answered=_fitted(step.answered))
    answered = step.answered
    names = Names(answered.program, _outputs(answered))
    kept = _workspace(answered, names)
    given = {value: f"workspace->{member.name}" for value, member in kept}
    checked = body(step.checked, dialect, sample, helpers)
    begun = body(step.begun, dialect, (*sample, "memory"), helpers)
    held = body(step.held, dialect, ("parameters", "memory"), helpers)
    into = [(text, value) for value, text in given.items()]
    derived = _body(answered, into, dialect, ("parameters", "workspace"), helpers, names, {})
    arguments = (*sample, "workspace", "memory", "command")
    inside = _body(answered, answered.assigned, dialect, arguments, helpers, names, given)
    total = sum(each.bytes for each in (checked, begun, held, derived, inside)) + CALLS
    return Source(
        checked=checked,
        begun=begun,
        held=held,
        derived=derived,
        answered=inside,
        workspace=[replace(member, meaning=_written(member.name, derived.lines)) for _, member in kept],
        helpers=helpers.lines,
        bytes=-(-total // 64) * 64,
    )


def body(function: Function, dialect: Dialect, arguments: Sequence[str], helpers: Helpers) -> Body:
    """The inside of a function.

    - `function`: its program and places.
    - `dialect`: how types and numbers are written.
    - `arguments`: names of the C function's arguments.
    - `helpers`: takes what it calls.
    """
    names = Names(function.program, _outputs(function))
    return _body(function, function.assigned, dialect, arguments, helpers, names, {})


def _body(
    function: Function,
    assigned: list[tuple[str, Value]],
    dialect: Dialect,
    arguments: Sequence[str],
    helpers: Helpers,
    names: Names,
    given: dict[Value, str],
) -> Body:
    local = [place.member.name for place in function.outputs if not place.pointer]
    written = statements(
        function.program,
        assigned,
        function.read,
        dialect=dialect,
        given=given,
        names=names,
        taken=(*arguments, *local),
    )
    helpers.extend(written.helpers)
    text = "\n".join(written.lines)
    unused = [f"    (void){name};" for name in arguments if f"{name}->" not in text and f"{name}[" not in text]
    return Body(unused + written.lines, written.bytes)


def _fitted(function: Function) -> Function:
    return replace(function, program=in_floats(function.program))


def _outputs(function: Function) -> dict[Value, str]:
    """Names for the values of signals, so that they are found again in the code."""
    return {
        value: place.member.name + suffix(k, place.member.shape)
        for place, output in zip(function.outputs, function.program.outputs, strict=True)
        if place.pointer == "command->"
        for k, value in enumerate(output.values or ())
        if value.op not in ("const", "input")
    }


def _written(name: str, lines: list[str]) -> str:
    """The expression that a member of the workspace is computed by."""
    start = f"    workspace->{name} = "
    return next((line.removeprefix(start).rstrip(";") for line in lines if line.startswith(start)), "")


def _workspace(function: Function, names: Names) -> list[tuple[Value, Member]]:
    """What follows from the parameters alone and is worth keeping, each with its member."""
    parameters = {k for k, place in enumerate(function.inputs) if place.pointer == "parameters->"}
    found: list[tuple[Value, Member]] = []
    taken = {"from", "known"}
    for value in loop_invariant(function.program, parameters):
        name = names.of(value)
        text = "derived" if name is None else name.text
        free = text
        for number in range(2, len(taken) + 3):
            if free not in taken:
                break
            free = f"{text}_{number}"
        taken.add(free)
        found.append((value, Member(free, value.type, ())))
    return found
