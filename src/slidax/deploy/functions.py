"""The functions that the programs of a step share, as C."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

from slidax.codegen.c import Callee, Dialect, Helpers, loop_invariant, statements
from slidax.codegen.digest import digest
from slidax.codegen.ir import Call, Program, Value, functions
from slidax.codegen.naming import Names
from slidax.codegen.naming.names import Name

from .members import Member
from .programs import Function, Place

TYPES = ("status_bits", "measured", "wanted", "settings", "remembered", "workshop")
"""What types are called in the file."""

RESULT = "result"
LEAST = 3
"""Elements that an array has at least."""


@dataclass
class Shared:
    """A function of the step.

    - `program`: itself.
    - `name`: in C.
    - `places`: for each input, the parameter that all calls give; None: each call gives another.
    - `lines`, `derived`: its body, and that of the function which computes what is kept.
    - `bytes`: what its variables take if each has a place of its own, those of the functions that it calls included.
    """

    program: Program
    name: str
    places: list[Place | None]
    lines: list[str] = field(default_factory=list)
    derived: list[str] = field(default_factory=list)
    bytes: int = 0
    derived_bytes: int = 0

    @property
    def passed(self) -> tuple[int, ...]:
        """The numbers of the inputs that each call gives."""
        return tuple(k for k, place in enumerate(self.places) if place is None)

    def argument(self, which: int) -> str:
        """The name of an input that is passed.

        - `which`: its number.
        """
        return "x" if len(self.passed) == 1 else f"x{self.passed.index(which) + 1}"

    def declared(self, dialect: Dialect) -> str:
        """The arguments in C that each call gives, and the array of the results.

        - `dialect`: how types are written.
        """
        given = []
        for k in self.passed:
            entry = self.program.inputs[k]
            brackets = f"[{entry.size}]" if entry.shape else ""
            before = "const " if entry.shape else ""
            given.append(f"{before}{dialect.type(entry.type)} {self.argument(k)}{brackets}")
        size = sum(output.size for output in self.program.outputs)
        return ", ".join([*given, f"{dialect.type('f64')} {RESULT}[{size}]"])

    @property
    def about(self) -> str:
        """What it computes, in a line."""
        return f"{self.name}: what the law asks for more than once."

    def read(self, which: int, element: int | str) -> str:
        """How an element of an input is read.

        - `which`: the input.
        - `element`: a number or an expression.
        """
        place = self.places[which]
        if place is not None:
            return place.element(element)
        name = self.argument(which)
        return f"{name}[{element}]" if self.program.inputs[which].shape else name


class Library:
    """All functions that some programs call.

    - `tops`: the programs, with the places of their inputs.
    - `taken`: names of other functions in C.
    """

    def __init__(self, tops: Sequence[Function], taken: Iterable[str]) -> None:
        self._by_digest: dict[str, Shared] = {}
        self._known: dict[int, tuple[Program, Shared]] = {}
        names = set(taken)
        for top in tops:
            for program in functions(top.program):
                what = digest(program)
                if what not in self._by_digest:
                    name = next(n for n in _numbered(program.name) if n not in names)
                    names.add(name)
                    self._by_digest[what] = Shared(program, name, [])
                self._known[id(program)] = (program, self._by_digest[what])
        self._find_places(tops)

    @property
    def shared(self) -> list[Shared]:
        """The functions, each after those that it calls."""
        return list(self._by_digest.values())

    def of(self, program: Program) -> Shared:
        """The function that a program is.

        - `program`: one that is called.
        """
        return self._known[id(program)][1]

    def callee(self, program: Program) -> Callee:
        """How a function is called.

        - `program`: the function.
        """
        shared = self.of(program)
        return Callee(shared.name, ("parameters", "workspace"), shared.passed)

    def write(self, dialect: Dialect, helpers: Helpers, members: Members) -> None:
        """Writes all functions.

        - `dialect`: how types and numbers are written.
        - `helpers`: takes what they call.
        - `members`: of the workspace so far.
        """
        for shared in self.shared:
            self._write(shared, dialect, helpers, members)

    def _find_places(self, tops: Sequence[Function]) -> None:
        seen: dict[int, list[list[Place | None]]] = {}
        callers: list[tuple[Program, list[Place | None]]] = [(top.program, list(top.inputs)) for top in tops]
        # From the outside in: where a function is called must be known before where its inputs lie.
        for shared in [None, *reversed(self.shared)]:
            if shared is not None:
                calls = seen.get(id(shared), [])
                shared.places = [
                    given[0] if len({_text(one) for one in given}) == 1 else None for given in zip(*calls, strict=True)
                ]
                callers = [(shared.program, shared.places)]
            for program, places in callers:
                for value in program.walk():
                    if isinstance(value, Call):
                        seen.setdefault(id(self.of(value.program)), []).append(_given(value, places))

    def _write(self, shared: Shared, dialect: Dialect, helpers: Helpers, members: Members) -> None:
        program = shared.program
        names = Names(program)
        fixed = {k for k, place in enumerate(shared.places) if place is not None}
        given = members.add(loop_invariant(program, fixed), names)
        outputs = [value for output in program.outputs for value in output.values or ()]
        arguments = [shared.argument(k) for k in shared.passed]
        taken = ("parameters", "workspace", RESULT, *TYPES, *arguments, *(one.name for one in self.shared))
        into = [(text, value) for value, text in given.items()]
        derived = statements(
            program, into, shared.read, dialect=dialect, names=names, callees=self.callee, loops=True, taken=taken
        )
        inside = statements(
            program,
            [(f"{RESULT}[{k}]", value) for k, value in enumerate(outputs)],
            shared.read,
            dialect=dialect,
            given=given,
            names=names,
            callees=self.callee,
            loops=True,
            taken=taken,
        )
        for written in (derived, inside):
            helpers.extend(written.helpers)
        shared.derived = derived.lines
        shared.lines = unused(inside.lines, ("parameters", "workspace"))
        shared.bytes = inside.bytes + self.deepest(inside.called)
        shared.derived_bytes = derived.bytes + self.deepest(derived.called)

    def deepest(self, called: Sequence[Program]) -> int:
        """The most bytes that a call of one of these takes.

        - `called`: functions.
        """
        return max((self.of(program).bytes + FRAME for program in called), default=0)


FRAME = 128
"""Bytes that a call takes beside its variables: saved registers and the return address."""


class Members:
    """The members of the workspace, as they are found."""

    def __init__(self) -> None:
        self.all: list[Member] = []
        self._taken = {"from", "known"}

    def add(self, values: Sequence[Value], names: Names) -> dict[Value, str]:
        """How values are read that are kept: from members of their own, or from one if they are of one array.

        - `values`: that are kept.
        - `names`: of the program that they belong to.
        """
        arrays: dict[object, list[Value]] = {}
        for value in values:
            visit = getattr(value.origin, "visit", None)
            arrays.setdefault((value if visit is None else visit, value.type), []).append(value)
        given: dict[Value, str] = {}
        for those in arrays.values():
            name = names.of(those[0])
            if len(those) < LEAST:
                given |= {value: f"workspace->{self._member(value, names.of(value), ()).name}" for value in those}
            else:
                member = self._member(those[0], name, (len(those),))
                given |= {value: f"workspace->{member.name}[{k}]" for k, value in enumerate(those)}
        return given

    def _member(self, value: Value, name: Name | None, shape: tuple[int, ...]) -> Member:
        text = "derived" if name is None else name.text
        if shape:
            text = re.sub(r"_\d+$", "", text)
        free = next(one for one in _numbered(text) if one not in self._taken)
        self._taken.add(free)
        self.all.append(Member(free, value.type, shape))
        return self.all[-1]


def unused(lines: list[str], arguments: Sequence[str]) -> list[str]:
    """The lines, after those that keep a compiler from warning of arguments that they do not read.

    - `lines`: of a function.
    - `arguments`: its names.
    """
    text = re.sub(r"/\*.*?\*/", "", "\n".join(lines), flags=re.DOTALL)
    # As a word of its own, and no member of a structure: `t` is not read by `at[0]` or `then->t`.
    return [f"    (void){name};" for name in arguments if not re.search(rf"(?<![.>\w]){name}\b", text)] + lines


def _given(call: Call, places: Sequence[Place | None]) -> list[Place | None]:
    """For each input of a call, the parameter that it is given."""
    found: list[Place | None] = []
    first = 0
    for entry in call.program.inputs:
        elements = call.args[first : first + entry.size]
        first += entry.size
        which = {value.data[0] for value in elements if value.op == "input"}
        place = places[min(which)] if len(which) == 1 else None
        whole = (
            place is not None
            and place.pointer == "parameters->"
            and place.member.size == entry.size
            and [value.data for value in elements] == [(min(which), k) for k in range(entry.size)]
        )
        found.append(place if whole else None)
    return found


def _text(place: Place | None) -> str:
    return "" if place is None else place.element(0)


def _numbered(name: str) -> Iterable[str]:
    yield name
    yield from (f"{name}_{number}" for number in range(2, 1000))
