"""The intermediate representation (IR): scalar operations in static single assignment, loops and branches as blocks.

A program is a tree of regions. Each region is a list of values in an order in which they can be computed; a value's
arguments stand earlier in its own region or in one around it. All operations are pure, except `store`.

| op | args | data | meaning |
|---|---|---|---|
| `const` | | number | as a Python float, int or bool |
| `input` | | (input, element) | one number of an input, its elements counted in C order |
| `param` | | k | the k-th of the numbers that a loop carries, at the start of a turn; lives in the loop's head |
| `result` | block | k | the k-th of what a loop, a branch or a call leaves behind |
| `call` | numbers | | what another program makes of them: its inputs' elements, one input after the other |
| `load` | index i64 | input | an input's element by a number that is known in range |
| `store` | row i64, when b1, numbers | output | writes one row of a logged output, where `when` is true |
| `add sub mul div neg abs min max` | | | of one type; floats: NaN if one of them is; integers: `div` towards zero |
| `rem` | | | what is left of a division towards zero: integers, and floats as `fmod` |
| `and or xor not shl shr sar` | | | integers; `and or xor not` also b1; `shr` brings in zeros, `sar` the sign |
| `fma` | a, b, c | | a b + c, rounded once |
| `sqrt floor ceil rint` | | | `rint`: halves to even |
| `exp expm1 log log1p pow sin cos tan asin acos atan atan2 sinh cosh tanh erf erf_inv cbrt` | | | as in `math.h` |
| `eq ne lt le gt ge` | of one type | | b1 |
| `select` | when b1, yes, no | | |
| `isfinite` | float | | b1 |
| `copy` | one | k | the same number, in the k-th of the program's arrays |
| `convert` | one | | to the value's type; floats to integers towards zero, held at its ends, NaN to 0; b1 to 0 or 1 |
| `bitcast` | one | | the same bits as another type of the same size |
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any, Literal

Type = Literal["f64", "f32", "i64", "i32", "u64", "u32", "b1", "none"]
"""Of a value; `none` for blocks and stores."""

FLOATS: tuple[Type, ...] = ("f64", "f32")
INTEGERS: tuple[Type, ...] = ("i64", "i32", "u64", "u32")

ELEMENTARY = [
    "exp",
    "expm1",
    "log",
    "log1p",
    "pow",
    "sin",
    "cos",
    "tan",
    "asin",
    "acos",
    "atan",
    "atan2",
    "sinh",
    "cosh",
    "tanh",
    "erf",
    "erf_inv",
    "cbrt",
]
"""Functions that no processor has; printed as calls, or written out beforehand."""

BLOCKS = frozenset({"loop", "branch"})
"""Operations that hold regions."""

Number = float | int | bool


class Region:
    """A list of values that are computed one after the other.

    - `kind`: "whole", "head" and "body" (of a loop: computed again and again), or "branch" (perhaps never computed).
    - `parent`: the region around it; None for the whole.
    - `owner`: the block that it belongs to; None for the whole.
    - `values`: in order.
    - `known`: the builder's memory of them.
    """

    __slots__ = ("kind", "known", "owner", "parent", "values")

    def __init__(self, kind: Literal["whole", "head", "body", "branch"], parent: Region | None) -> None:
        self.kind = kind
        self.parent = parent
        self.owner: Value | None = None
        self.values: list[Value] = []
        self.known: dict[Any, Value] = {}

    def within(self, other: Region) -> bool:
        """Whether this region is the other one or lies inside of it."""
        region: Region | None = self
        while region is not None:
            if region is other:
                return True
            region = region.parent
        return False


class Value:
    """One operation and what it gives.

    - `op`, `type`, `args`, `data`: see the table above.
    - `region`: where it is computed.
    - `number`: its own, growing in the order of making.
    - `origin`: whatever tells where in the source it came from.
    """

    __slots__ = ("args", "data", "number", "op", "origin", "region", "type")

    def __init__(
        self, op: str, type: Type, args: tuple[Value, ...], data: Any, region: Region, number: int, origin: Any
    ) -> None:
        self.op = op
        self.type = type
        self.args = args
        self.data = data
        self.region = region
        self.number = number
        self.origin = origin

    def __repr__(self) -> str:
        return f"%{self.number}:{self.type} = {self.op}({', '.join(f'%{a.number}' for a in self.args)}) {self.data}"


class Loop(Value):
    """`while condition: carried = following`, with `args` the numbers carried into the first turn.

    - `head`: the region of the condition; `params` live there.
    - `params`: the carried numbers at the start of a turn.
    - `condition`: b1; whether there is another turn.
    - `body`: a region inside the head.
    - `following`: the carried numbers for the next turn.
    - `turns`: the number of turns, if it is known and the same for all; `params[0]` then counts them from 0.
    """

    __slots__ = ("body", "condition", "following", "head", "params", "turns")
    head: Region
    body: Region
    params: tuple[Value, ...]
    condition: Value
    following: tuple[Value, ...]
    turns: Value | None


class Branch(Value):
    """`yes if args[0] else no`, of which only one is computed.

    - `then`, `otherwise`: the regions.
    - `yes`, `no`: the numbers that each leaves.
    """

    __slots__ = ("no", "otherwise", "then", "yes")
    then: Region
    otherwise: Region
    yes: tuple[Value, ...]
    no: tuple[Value, ...]


class Call(Value):
    """What a function makes of some numbers: a program of its own, that many calls share.

    - `program`: the function; it logs nothing. The call's `args` are the elements of its inputs, one input after the
      other, and its results the elements of its outputs likewise.
    """

    __slots__ = ("program",)
    program: Program


@dataclass(frozen=True)
class Input:
    """An array that a program reads.

    - `name`, `type`, `shape`: its own.
    - `varying`: whether each run of a batch has its own.
    """

    name: str
    type: Type
    shape: tuple[int, ...]
    varying: bool = False

    @property
    def size(self) -> int:
        """How many numbers."""
        return _product(self.shape)


@dataclass
class Output:
    """An array that a program writes.

    - `name`, `type`, `shape`: its own; `shape` is that of one row if it is logged.
    - `values`: in C order; None if it is logged, row by row, by `store`.
    """

    name: str
    type: Type
    shape: tuple[int, ...]
    values: tuple[Value, ...] | None

    @property
    def size(self) -> int:
        """How many numbers, in one row if it is logged."""
        return _product(self.shape)


@dataclass
class Program:
    """A pure function of arrays.

    - `inputs`, `outputs`: in order.
    - `body`: the outermost region.
    - `name`: what the source calls it; empty for what is no function of the source.
    - `arrays`: values that the source computes as one array, in C order, for printers that have arrays.
    """

    inputs: list[Input] = field(default_factory=list)
    outputs: list[Output] = field(default_factory=list)
    body: Region = field(default_factory=lambda: Region("whole", None))
    name: str = ""
    arrays: list[tuple[Value, ...]] = field(default_factory=list)

    def walk(self) -> Iterator[Value]:
        """All values, blocks before what is in them, each region in order."""
        yield from walk(self.body)


def functions(program: Program) -> list[Program]:
    """The functions that a program calls, and those that they call, each once and after all that it calls itself.

    - `program`: the program.
    """
    found: dict[int, Program] = {}
    for value in program.walk():
        if isinstance(value, Call) and id(value.program) not in found:
            for inner in (*functions(value.program), value.program):
                found.setdefault(id(inner), inner)
    return list(found.values())


def walk(region: Region) -> Iterator[Value]:
    """All values of a region and of the regions inside it, blocks before what is in them."""
    for value in region.values:
        yield value
        if value.op in BLOCKS:
            for inner in regions(value):
                yield from walk(inner)


def regions(value: Value) -> tuple[Region, ...]:
    """The regions that a block holds; none for other values. A loop's body lies in its head."""
    if isinstance(value, Loop):
        return (value.head, value.body)
    if isinstance(value, Branch):
        return (value.then, value.otherwise)
    return ()


def uses(value: Value) -> tuple[Value, ...]:
    """All values that a value needs: its arguments, and what its blocks leave behind."""
    if isinstance(value, Loop):
        return (*value.args, value.condition, *value.following)
    if isinstance(value, Branch):
        return (*value.args, *value.yes, *value.no)
    return value.args


def _product(shape: tuple[int, ...]) -> int:
    size = 1
    for length in shape:
        size *= length
    return size
