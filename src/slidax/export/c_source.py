"""C source of the programs of a guarded step, and of the functions that these programs share.

A program is a function as a list of scalar operations (`slidax.codegen.ir.Program`).
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

from slidax.codegen.c.expressions import Dialect, Helpers
from slidax.codegen.c.functions import statements
from slidax.codegen.c.placement import loop_invariant
from slidax.codegen.c.writer import Callee
from slidax.codegen.ir import Call, Program, Value, digest, functions
from slidax.codegen.naming.names import Name, Names, index_suffix
from slidax.motions.stream import Streamed
from slidax.motions.trajectory import AbstractMotion

from .c_structures import Member
from .programs import CArray, Function, StepPrograms, stream_program, with_float_constants

TYPES = ("status_bits", "measured", "wanted", "settings", "remembered", "workshop")
"""Names of the types in the C file, which no variable may have."""

RESULT = "result"
"""Name of the array for the results of a shared function."""

LEAST = 3
"""Fewest values that the workspace stores as an array; fewer become separate members."""


@dataclass(frozen=True)
class FunctionBody:
    """Body of a C function.

    - `lines`: lines of C, indented, including those that silence warnings about unused arguments.
    - `bytes`: bound of its stack, including the deepest call [bytes]. It assumes that arrays of one block share no
      memory.
    """

    lines: list[str]
    bytes: int


NO_BODY = FunctionBody([], 0)


@dataclass
class SharedFunction:
    """A C function that the law's programs call more than once.

    - `program`: the operations of the function.
    - `name`: name in C.
    - `arrays`: one entry for each input of the program. If all calls pass the same law parameter, it is this parameter,
      which the body reads directly. Otherwise it is None, and the C function has an argument for the input.
    - `body`: its body.
    - `derived`: body of a second C function, which precomputes those values that depend only on the parameters.
    """

    program: Program
    name: str
    arrays: list[CArray | None]
    body: FunctionBody = NO_BODY
    derived: FunctionBody = NO_BODY

    @property
    def local(self) -> list[str]:
        """Reserved names: those of its arguments, and that of the array for its results."""
        return [RESULT, *(self.argument(k) for k in self.passed)]

    @property
    def passed(self) -> tuple[int, ...]:
        """Indices of the program's inputs that are passed as arguments."""
        return tuple(k for k, array in enumerate(self.arrays) if array is None)

    def argument(self, which: int) -> str:
        """Return the name of the argument for an input; `which` is the input's index."""
        return "x" if len(self.passed) == 1 else f"x{self.passed.index(which) + 1}"

    def declarations(self, dialect: Dialect) -> str:
        """Return the declarations of the arguments and of the results' array in C."""
        arguments = []
        for k in self.passed:
            entry = self.program.inputs[k]
            brackets = f"[{entry.size}]" if entry.shape else ""
            before = "const " if entry.shape else ""
            arguments.append(f"{before}{dialect.type(entry.type)} {self.argument(k)}{brackets}")
        size = sum(output.size for output in self.program.outputs)
        return ", ".join([*arguments, f"{dialect.type('f64')} {RESULT}[{size}]"])

    @property
    def about(self) -> str:
        """One-line comment of the function in C."""
        return f"{self.name}: computed more than once by the law."

    def read(self, which: int, element: int | str) -> str:
        """Return the C expression that reads an input's element; `which` is the input's index."""
        array = self.arrays[which]
        if array is not None:
            return array.element(element)
        name = self.argument(which)
        return f"{name}[{element}]" if self.program.inputs[which].shape else name


class SharedFunctions:
    """The C functions that the programs of a step call; equal functions become one.

    - `tops`: the calling programs, with the C arrays of their inputs.
    - `taken`: names of other functions and types in C, which these functions must not have.
    """

    def __init__(self, tops: Sequence[Function], taken: Iterable[str]) -> None:
        self._by_digest: dict[str, SharedFunction] = {}
        self._known: dict[int, tuple[Program, SharedFunction]] = {}
        names = set(taken)
        for top in tops:
            for program in functions(top.program):
                key = digest(program)
                if key not in self._by_digest:
                    name = next(n for n in _numbered(program.name) if n not in names)
                    names.add(name)
                    self._by_digest[key] = SharedFunction(program, name, [])
                self._known[id(program)] = (program, self._by_digest[key])
        self._find_arrays(tops)

    @property
    def shared(self) -> list[SharedFunction]:
        """The functions, sorted so that each follows those that it calls."""
        return list(self._by_digest.values())

    def of(self, program: Program) -> SharedFunction:
        """Return the C function of a called program."""
        return self._known[id(program)][1]

    def callee(self, program: Program) -> Callee:
        """Return the C function's name and arguments for calls to a program."""
        shared = self.of(program)
        return Callee(shared.name, ("parameters", "workspace"), shared.passed)

    def write(self, dialect: Dialect, helpers: Helpers, members: WorkspaceMembers) -> None:
        """Write the C bodies of all functions, and store them in `shared`.

        - `helpers`: collects the small functions that they call.
        - `members`: collects the members of the workspace.
        """
        for shared in self.shared:
            self._write(shared, dialect, helpers, members)

    def _find_arrays(self, tops: Sequence[Function]) -> None:
        calls_of: dict[int, list[list[CArray | None]]] = {}
        callers: list[tuple[Program, list[CArray | None]]] = [(top.program, list(top.inputs)) for top in tops]
        # From the outermost program inwards: the arrays of a function's inputs follow from its callers.
        for shared in [None, *reversed(self.shared)]:
            if shared is not None:
                calls = calls_of.get(id(shared), [])
                shared.arrays = [
                    passed[0] if len({_text(array) for array in passed}) == 1 else None
                    for passed in zip(*calls, strict=True)
                ]
                callers = [(shared.program, shared.arrays)]
            for program, arrays in callers:
                for value in program.walk():
                    if isinstance(value, Call):
                        calls_of.setdefault(id(self.of(value.program)), []).append(_passed(value, arrays))

    def _write(self, shared: SharedFunction, dialect: Dialect, helpers: Helpers, members: WorkspaceMembers) -> None:
        program, names, shares = shared.program, Names(shared.program), ("parameters", "workspace")
        fixed = {k for k, array in enumerate(shared.arrays) if array is not None}
        kept = members.add(loop_invariant(program, fixed), names)
        outputs = [value for output in program.outputs for value in output.values or ()]
        results = [(f"{RESULT}[{k}]", value) for k, value in enumerate(outputs)]
        if kept:
            shared.derived = function_body(shared, dialect, shares, helpers, self, names, _stored(kept))
        shared.body = function_body(shared, dialect, shares, helpers, self, names, results, kept)

    def deepest(self, called: Sequence[Program]) -> int:
        """Return the largest stack that a call to any of these programs needs in C [bytes]; 0 for no program."""
        return max((self.of(program).body.bytes + FRAME for program in called), default=0)


FRAME = 128
"""Stack of a call in addition to its variables [bytes]: saved registers and the return address."""


class WorkspaceMembers:
    """Members of the workspace, the C structure for values that depend only on the parameters."""

    def __init__(self) -> None:
        self.all: list[Member] = []
        self._taken = {"from", "known"}

    def add(self, values: Sequence[Value], names: Names) -> dict[Value, str]:
        """Add values to the workspace, and return the C expression that reads each.

        At least `LEAST` values that the Python source computes as one array become an array in C.

        - `names`: C names of the values in their program.
        """
        arrays: dict[object, list[Value]] = {}
        for value in values:
            visit = getattr(value.origin, "visit", None)
            arrays.setdefault((value if visit is None else visit, value.type), []).append(value)
        kept: dict[Value, str] = {}
        for those in arrays.values():
            name = names.of(those[0])
            if len(those) < LEAST:
                kept |= {value: f"workspace->{self._member(value, names.of(value), ()).name}" for value in those}
            else:
                member = self._member(those[0], name, (len(those),))
                kept |= {value: f"workspace->{member.name}[{k}]" for k, value in enumerate(those)}
        return kept

    def _member(self, value: Value, name: Name | None, shape: tuple[int, ...]) -> Member:
        text = "derived" if name is None else name.text
        if shape:
            text = re.sub(r"_\d+$", "", text)
        free = next(candidate for candidate in _numbered(text) if candidate not in self._taken)
        self._taken.add(free)
        self.all.append(Member(free, value.type, shape))
        return self.all[-1]


def with_unused_arguments(lines: list[str], arguments: Sequence[str]) -> list[str]:
    """Return the lines of a C function, preceded by a line `(void)name;` for each argument that they do not read."""
    text = re.sub(r"/\*.*?\*/", "", "\n".join(lines), flags=re.DOTALL)
    # Whole words, and no members of structures: neither `at[0]` nor `then->t` reads `t`.
    return [f"    (void){name};" for name in arguments if not re.search(rf"(?<![.>\w]){name}\b", text)] + lines


def _passed(call: Call, arrays: Sequence[CArray | None]) -> list[CArray | None]:
    """Return for each input of a call the parameter that is passed to it; None if it is not a whole parameter."""
    passed: list[CArray | None] = []
    first = 0
    for entry in call.program.inputs:
        elements = call.args[first : first + entry.size]
        first += entry.size
        which = {value.data[0] for value in elements if value.op == "input"}
        array = arrays[min(which)] if len(which) == 1 else None
        whole = (
            array is not None
            and array.pointer == "parameters->"
            and array.member.size == entry.size
            and [value.data for value in elements] == [(min(which), k) for k in range(entry.size)]
        )
        passed.append(array if whole else None)
    return passed


def _text(array: CArray | None) -> str:
    return "" if array is None else array.element(0)


def _numbered(name: str) -> Iterable[str]:
    yield name
    yield from (f"{name}_{number}" for number in range(2, 1000))


@dataclass(frozen=True)
class StepSource:
    """C source of all functions of a step.

    - `checked`, `begun`, `held`, `valid`, `answered`: bodies of the functions in `StepPrograms`.
    - `derived`: body of the function that computes the workspace.
    - `functions`: functions that the law calls, sorted so that each follows those that it calls.
    - `workspace`: members for values that depend only on the parameters.
    - `helpers`: lines of the small functions that all these functions call.
    - `bytes`: upper bound of a step's stack [bytes], with a reserve for the compiler. It assumes that arrays of one
      block share no memory, and that blocks and functions which run one after the other use the same memory.
    """

    checked: FunctionBody
    begun: FunctionBody
    held: FunctionBody
    valid: FunctionBody
    derived: FunctionBody
    answered: FunctionBody
    functions: list[SharedFunction]
    workspace: list[Member]
    helpers: list[str]
    bytes: int


@dataclass(frozen=True)
class StreamCode:
    """The filter that turns a host's streamed positions into a reference, in C.

    - `options`, `state`: members of the C structures for its options and its state.
    - `body`: body of its step function.
    - `helpers`: lines of the small functions that the step calls.
    """

    options: list[Member]
    state: list[Member]
    body: FunctionBody
    helpers: list[str]

    @classmethod
    def of(cls, motion: AbstractMotion, joints: int, dialect: Dialect) -> StreamCode | None:
        """Return the filter of a streamed motion in C; None for other motions."""
        if not isinstance(motion, Streamed):
            return None
        step, options, state = stream_program(motion.stream, joints)
        helpers = Helpers(dialect)
        body = function_body(step, dialect, ("stream", "options", "newest", "fresh", "reference"), helpers)
        return cls(options, state, body, helpers.lines)


CALLS = {"double": 640, "float": 512}
"""Stack for calls [bytes], by number type: return addresses, saved registers, arguments, intermediate results."""

SPILLED = 1.4
"""Largest stack that a compiler which unrolls loops uses, relative to that of the variables."""

TAKEN = ("checked", "begun", "held", "within", "related", "derived", "kept_up", "answered")
"""Functions of the C file that do not come from the law."""


def step_source(step: StepPrograms, dialect: Dialect) -> StepSource:
    """Return the C source of all functions of a guarded step."""
    helpers = Helpers(dialect)
    sample = ("parameters", "measurement", "reference")
    if dialect.real == "float":
        step = replace(step, begun=_fitted(step.begun), answered=_fitted(step.answered))
    answered = step.answered
    library, members = SharedFunctions((answered, step.begun), (*TAKEN, *TYPES)), WorkspaceMembers()
    names = Names(answered.program, _outputs(answered))
    parameters = {k for k, array in enumerate(answered.inputs) if array.pointer == "parameters->"}
    kept = members.add(loop_invariant(answered.program, parameters), names)
    library.write(dialect, helpers, members)
    checked = function_body(step.checked, dialect, sample, helpers)
    begun = function_body(step.begun, dialect, (*sample, "workspace", "memory"), helpers, library)
    held = function_body(step.held, dialect, ("parameters", "memory"), helpers)
    valid = function_body(step.valid, dialect, ("parameters",), helpers)
    shares = ("parameters", "workspace")
    derived = function_body(answered, dialect, shares, helpers, library, names, _stored(kept))
    arguments = (*sample, "workspace", "memory", "command")
    inside = function_body(answered, dialect, arguments, helpers, library, names, answered.assigned, kept)
    # These functions run one after the other; of those for the workspace, only `derived` calls others.
    deriving = derived.bytes + max((each.derived.bytes for each in library.shared), default=0)
    total = (
        round(SPILLED * max(checked.bytes, held.bytes, valid.bytes, begun.bytes, deriving, inside.bytes))
        + CALLS[dialect.real]
    )
    lines = [*derived.lines, *(line for each in library.shared for line in each.derived.lines)]
    return StepSource(
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


def function_body(
    function: Function | SharedFunction,
    dialect: Dialect,
    arguments: Sequence[str],
    helpers: Helpers,
    library: SharedFunctions | None = None,
    names: Names | None = None,
    assigned: list[tuple[str, Value]] | None = None,
    kept: Mapping[Value, str] | None = None,
) -> FunctionBody:
    """Write the operations of a function as the body of a C function, and return it.

    - `arguments`: names of the C function's arguments.
    - `helpers`: collects the small functions that it calls.
    - `library`: the shared functions that it may call.
    - `names`: C names of its values; None to name them after the signals and the variables in the Python source.
    - `assigned`: the C lvalues that it assigns, with their values; None for the program's outputs.
    - `kept`: precomputed values, with the C expressions that read them.
    """
    if isinstance(function, Function):
        names = names or Names(function.program, _outputs(function))
        assigned = function.assigned if assigned is None else assigned
    called = [] if library is None else [shared.name for shared in library.shared]
    written = statements(
        function.program,
        assigned or [],
        function.read,
        dialect=dialect,
        precomputed=kept,
        names=names,
        callees=None if library is None else library.callee,
        loops=True,
        taken=(*arguments, *function.local, *called, *TYPES, *TAKEN),
    )
    helpers.extend(written.helpers)
    deepest = 0 if library is None else library.deepest(written.called)
    return FunctionBody(with_unused_arguments(written.lines, arguments), written.bytes + deepest)


def _stored(kept: Mapping[Value, str]) -> list[tuple[str, Value]]:
    return [(text, value) for value, text in kept.items()]


def _fitted(function: Function) -> Function:
    return replace(function, program=with_float_constants(function.program))


def _outputs(function: Function) -> dict[Value, str]:
    """Return the signal's name for each value that is a signal, so that a reader recognises it in the C code."""
    return {
        value: array.member.name + index_suffix(k, array.member.shape)
        for array, output in zip(function.outputs, function.program.outputs, strict=True)
        if array.pointer == "command->"
        for k, value in enumerate(output.values or ())
        if value.op not in ("const", "input")
    }


def _written(name: str, lines: list[str]) -> str:
    """Return the C expression that computes a member of the workspace."""
    start = f"    workspace->{name} = "
    return next((line.removeprefix(start).rstrip(";") for line in lines if line.startswith(start)), "")
