"""C functions that the programs of a step share."""

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
"""Names of the types in the C file."""

RESULT = "result"
LEAST = 3
"""Fewest elements of an array."""


@dataclass
class Shared:
    """A function of the step.

    - `name`: in C.
    - `places`: for each input, the parameter that all calls pass; None if calls differ.
    - `lines`, `derived`: its body, and the body of the function that precomputes from the parameters.
    - `bytes`, `derived_bytes`: stack of their variables, each in a place of its own, including called functions.
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
        """Indices of the inputs that are passed as arguments."""
        return tuple(k for k, place in enumerate(self.places) if place is None)

    def argument(self, which: int) -> str:
        """Name of a passed input."""
        return "x" if len(self.passed) == 1 else f"x{self.passed.index(which) + 1}"

    def declarations(self, dialect: Dialect) -> str:
        """The arguments in C, and the array of the results."""
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
        """Comment of the function, in a line."""
        return f"{self.name}: computed more than once by the law."

    def read(self, which: int, element: int | str) -> str:
        """C expression of an input's element."""
        place = self.places[which]
        if place is not None:
            return place.element(element)
        name = self.argument(which)
        return f"{name}[{element}]" if self.program.inputs[which].shape else name


class Library:
    """All functions called by some programs.

    - `tops`: the programs, with the places of their inputs.
    - `taken`: names of other functions in C.
    """

    def __init__(self, tops: Sequence[Function], taken: Iterable[str]) -> None:
        self._by_digest: dict[str, Shared] = {}
        self._known: dict[int, tuple[Program, Shared]] = {}
        names = set(taken)
        for top in tops:
            for program in functions(top.program):
                key = digest(program)
                if key not in self._by_digest:
                    name = next(n for n in _numbered(program.name) if n not in names)
                    names.add(name)
                    self._by_digest[key] = Shared(program, name, [])
                self._known[id(program)] = (program, self._by_digest[key])
        self._find_places(tops)

    @property
    def shared(self) -> list[Shared]:
        """The functions, each after those that it calls."""
        return list(self._by_digest.values())

    def of(self, program: Program) -> Shared:
        """The function of a called program."""
        return self._known[id(program)][1]

    def callee(self, program: Program) -> Callee:
        """Description of a call."""
        shared = self.of(program)
        return Callee(shared.name, ("parameters", "workspace"), shared.passed)

    def write(self, dialect: Dialect, helpers: Helpers, members: Members) -> None:
        """Write all functions; `helpers` collects the small functions they call, `members` the workspace."""
        for shared in self.shared:
            self._write(shared, dialect, helpers, members)

    def _find_places(self, tops: Sequence[Function]) -> None:
        calls_of: dict[int, list[list[Place | None]]] = {}
        callers: list[tuple[Program, list[Place | None]]] = [(top.program, list(top.inputs)) for top in tops]
        # From the outside in: the places of a function's inputs follow from its callers.
        for shared in [None, *reversed(self.shared)]:
            if shared is not None:
                calls = calls_of.get(id(shared), [])
                shared.places = [
                    passed[0] if len({_text(place) for place in passed}) == 1 else None
                    for passed in zip(*calls, strict=True)
                ]
                callers = [(shared.program, shared.places)]
            for program, places in callers:
                for value in program.walk():
                    if isinstance(value, Call):
                        calls_of.setdefault(id(self.of(value.program)), []).append(_passed(value, places))

    def _write(self, shared: Shared, dialect: Dialect, helpers: Helpers, members: Members) -> None:
        program = shared.program
        names = Names(program)
        fixed = {k for k, place in enumerate(shared.places) if place is not None}
        kept = members.add(loop_invariant(program, fixed), names)
        outputs = [value for output in program.outputs for value in output.values or ()]
        arguments = [shared.argument(k) for k in shared.passed]
        taken = ("parameters", "workspace", RESULT, *TYPES, *arguments, *(each.name for each in self.shared))
        into = [(text, value) for value, text in kept.items()]
        derived = statements(
            program, into, shared.read, dialect=dialect, names=names, callees=self.callee, loops=True, taken=taken
        )
        inside = statements(
            program,
            [(f"{RESULT}[{k}]", value) for k, value in enumerate(outputs)],
            shared.read,
            dialect=dialect,
            precomputed=kept,
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
        """Largest stack of a call to one of these functions [bytes]."""
        return max((self.of(program).bytes + FRAME for program in called), default=0)


FRAME = 128
"""Stack of a call in addition to its variables [bytes]: saved registers and the return address."""


class Members:
    """Members of the workspace."""

    def __init__(self) -> None:
        self.all: list[Member] = []
        self._taken = {"from", "known"}

    def add(self, values: Sequence[Value], names: Names) -> dict[Value, str]:
        """Add values to the workspace, those of one array together; return the C expression of each.

        - `names`: of the program that the values belong to.
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


def unused(lines: list[str], arguments: Sequence[str]) -> list[str]:
    """Prepend `(void)` lines for arguments that a function's lines do not read."""
    text = re.sub(r"/\*.*?\*/", "", "\n".join(lines), flags=re.DOTALL)
    # Whole words, and no members of structures: neither `at[0]` nor `then->t` reads `t`.
    return [f"    (void){name};" for name in arguments if not re.search(rf"(?<![.>\w]){name}\b", text)] + lines


def _passed(call: Call, places: Sequence[Place | None]) -> list[Place | None]:
    """For each input of a call, the parameter passed to it."""
    passed: list[Place | None] = []
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
        passed.append(place if whole else None)
    return passed


def _text(place: Place | None) -> str:
    return "" if place is None else place.element(0)


def _numbered(name: str) -> Iterable[str]:
    yield name
    yield from (f"{name}_{number}" for number in range(2, 1000))
