"""Intermediate representation (IR) of programs: scalar operations in static single assignment, loops and branches.

A run evaluates a program once. A batch is many runs of one program, whose varying inputs differ between the runs.
"""

from __future__ import annotations

import functools
import hashlib
import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np

from slidax.core.errors import DefinitionError

Type = Literal["f64", "f32", "i64", "i32", "u64", "u32", "b1", "none"]
"""Type of a value; `none` for blocks and stores."""

DTYPES: dict[Type, Any] = {
    "f64": np.float64,
    "f32": np.float32,
    "i64": np.int64,
    "i32": np.int32,
    "u64": np.uint64,
    "u32": np.uint32,
    "b1": np.bool_,
}
"""NumPy dtype of each type."""

FLOATS: tuple[Type, ...] = ("f64", "f32")

ELEMENTARY = (
    *("exp", "expm1", "log", "log1p", "pow", "sin", "cos", "tan", "asin", "acos", "atan", "atan2"),
    *("sinh", "cosh", "tanh", "erf", "erf_inv", "cbrt"),
)
"""Functions without a CPU instruction: printed as calls, or first expanded into basic operations."""

BLOCKS = frozenset({"loop", "branch"})
"""Operations that contain other operations, in regions."""

PLACED = frozenset({"const", "input", "param", "result"})
"""Operations that need no computation, because their value exists already."""

Number = float | int | bool


@dataclass(slots=True, eq=False)
class Region:
    """A list of IR values that are computed one after the other: a program, a part of a loop, or a side of a branch.

    - `kind`: "program" for the outermost region, "head" for a loop's condition, "body" for the rest of the loop,
      "branch" for a side of a branch.
    - `parent`: surrounding region; None for the outermost.
    - `owner`: the loop or branch to which it belongs; None for the outermost.
    - `values`: values in order of computation.
    - `known`: values by operation and arguments; the builder uses them to avoid duplicates.
    """

    kind: Literal["program", "head", "body", "branch"]
    parent: Region | None
    owner: Value | None = None
    values: list[Value] = field(default_factory=list)
    known: dict[Any, Value] = field(default_factory=dict)

    def within(self, other: Region) -> bool:
        """True if this region is `other`, or lies inside it."""
        region: Region | None = self
        while region is not None:
            if region is other:
                return True
            region = region.parent
        return False


@dataclass(slots=True, eq=False, repr=False)
class Value:
    """One operation and its result.

    - `op`: name of the operation, such as "add", "const", "input", "load" or "loop".
    - `type`: type of the result.
    - `args`: operands.
    - `data`: for "const", the number; for "input", the indices of the input and of the element; for "load" and "store",
      the index of the input or output; for "param" and "result", the index of the carried value or result; for "copy",
      a key that differs between copies of one value; None for other operations.
    - `region`: region in which it is computed.
    - `number`: unique, increasing in the order of construction.
    - `origin`: location in the Python source, as the tracer records it; None if it is not recorded.
    """

    op: str
    type: Type
    args: tuple[Value, ...]
    data: Any
    region: Region
    number: int
    origin: Any = None

    def __repr__(self) -> str:
        return f"%{self.number}:{self.type} = {self.op}({', '.join(f'%{a.number}' for a in self.args)}) {self.data}"


class Loop(Value):
    """The loop `while condition: carried = following`. Carried values are those that pass from iteration to iteration.

    - `args`: initial carried values.
    - `head`: region that computes the condition and defines `params`.
    - `params`: carried values at the start of an iteration.
    - `condition`: b1; true if another iteration follows.
    - `body`: region inside the head that computes `following`.
    - `following`: carried values for the next iteration.
    - `iterations`: number of iterations, if known and equal for all runs of a batch; `params[0]` then counts them from
      0. Otherwise None.
    """

    __slots__ = ("body", "condition", "following", "head", "iterations", "params")
    head: Region
    body: Region
    params: tuple[Value, ...]
    condition: Value
    following: tuple[Value, ...]
    iterations: Value | None


class Branch(Value):
    """The choice `yes if args[0] else no`; only the chosen side is computed.

    - `then`, `otherwise`: regions of the sides.
    - `yes`, `no`: values that `then` and `otherwise` return.
    """

    __slots__ = ("no", "otherwise", "then", "yes")
    then: Region
    otherwise: Region
    yes: tuple[Value, ...]
    no: tuple[Value, ...]


class Call(Value):
    """A call of a function, which is a separate program that many calls share.

    - `program`: the function, which has no logs (outputs written row by row). The call's `args` are the elements of all
      inputs, input by input; the call's results are the elements of all outputs, output by output.
    """

    __slots__ = ("program",)
    program: Program


@dataclass(frozen=True)
class Input:
    """Array that a program reads.

    - `varying`: true if the values differ between the runs of a batch.
    """

    name: str
    type: Type
    shape: tuple[int, ...]
    varying: bool = False

    @property
    def size(self) -> int:
        """Number of elements."""
        return math.prod(self.shape)


@dataclass
class Output:
    """Array that a program writes: once at its end, or row by row as a log.

    - `shape`: shape of the array, or of one row of a log.
    - `values`: elements in C order; None for a log, whose rows are written by the operation `store`.
    """

    name: str
    type: Type
    shape: tuple[int, ...]
    values: tuple[Value, ...] | None

    @property
    def size(self) -> int:
        """Number of elements; for a log, of one row."""
        return math.prod(self.shape)


@dataclass
class Program:
    """A pure function of arrays, in the intermediate representation.

    - `body`: outermost region, with all operations.
    - `name`: name of the function in the Python source, or empty.
    - `arrays`: groups of values, each of which the Python source computes as one array, in C order. Generated C can
      store such a group in an array.
    """

    inputs: list[Input] = field(default_factory=list)
    outputs: list[Output] = field(default_factory=list)
    body: Region = field(default_factory=lambda: Region("program", None))
    name: str = ""
    arrays: list[tuple[Value, ...]] = field(default_factory=list)

    def walk(self) -> Iterator[Value]:
        """Iterate over all IR values; a loop or branch comes before the values inside it."""
        yield from walk(self.body)


def checked_inputs(program: Program, inputs: Sequence[Any], runs: int | None) -> list[np.ndarray]:
    """Check the inputs of a program, and return them as NumPy arrays.

    - `inputs`: arrays in the program's shapes and dtypes; those that vary have a first axis for the runs.
    - `runs`: number of runs; None for a single run, whose inputs do not have that axis.

    Raises DefinitionError if the number of inputs, a shape or a dtype differs from the program's.
    """
    if len(inputs) != len(program.inputs):
        raise DefinitionError(f"the program has {len(program.inputs)} inputs; got {len(inputs)}")
    arrays = [np.asarray(array) for array in inputs]
    for array, entry in zip(arrays, program.inputs, strict=True):
        shape = (runs, *entry.shape) if entry.varying and runs is not None else entry.shape
        dtype = np.dtype(DTYPES[entry.type])
        if array.shape != shape or array.dtype != dtype:
            raise DefinitionError(
                f"input `{entry.name}` must be {dtype} of shape {list(shape)}; "
                f"got {array.dtype} of shape {list(array.shape)}"
            )
    return arrays


def functions(program: Program) -> list[Program]:
    """Return all programs that a program calls, directly or indirectly; a called one comes before its callers."""
    programs: dict[int, Program] = {}
    for value in program.walk():
        if isinstance(value, Call) and id(value.program) not in programs:
            for inner in (*functions(value.program), value.program):
                programs.setdefault(id(inner), inner)
    return list(programs.values())


def walk(region: Region) -> Iterator[Value]:
    """Iterate over all IR values of a region; a loop or branch comes before the values inside it."""
    for value in region.values:
        yield value
        if value.op in BLOCKS:
            for inner in regions(value):
                yield from walk(inner)


def regions(value: Value) -> tuple[Region, ...]:
    """Return the regions of a loop (head and body) or of a branch (both sides); for other values, an empty tuple."""
    if isinstance(value, Loop):
        return (value.head, value.body)
    if isinstance(value, Branch):
        return (value.then, value.otherwise)
    return ()


def uses(value: Value) -> tuple[Value, ...]:
    """Return all IR values that a value directly needs.

    These are its arguments; for a loop also the condition and the next carried values, for a branch also the results of
    both sides.
    """
    if isinstance(value, Loop):
        return (*value.args, value.condition, *value.following)
    if isinstance(value, Branch):
        return (*value.args, *value.yes, *value.no)
    return value.args


def digest(program: Program) -> str:
    """Return a SHA-256 digest (hexadecimal) of a program and of slidax.codegen's sources: a key for cached code."""
    lines = [program.name] if program.name else []
    lines += [f"{entry.name} {entry.type} {entry.shape} {entry.varying}" for entry in program.inputs]
    numbers: dict[Value, int] = {}
    _describe(program.body, numbers, lines)
    for output in program.outputs:
        values = None if output.values is None else [numbers[value] for value in output.values]
        lines.append(f"{output.name} {output.type} {output.shape} {values}")
    sha = hashlib.sha256("\n".join(lines).encode())
    sha.update(_sources())
    return sha.hexdigest()


def _describe(region: Region, numbers: dict[Value, int], lines: list[str]) -> None:
    for value in region.values:
        args = [numbers[arg] for arg in value.args]
        numbers[value] = len(numbers)
        if isinstance(value, Loop):
            for param in value.params:
                numbers[param] = len(numbers)
            lines.append(f"loop {args}")
            _describe(value.head, numbers, lines)
            lines.append(
                f"while {numbers[value.condition]} {None if value.iterations is None else numbers[value.iterations]}"
            )
            _describe(value.body, numbers, lines)
            lines.append(f"again {[numbers[carried] for carried in value.following]}")
        elif isinstance(value, Branch):
            lines.append(f"if {args}")
            for side, left in ((value.then, value.yes), (value.otherwise, value.no)):
                _describe(side, numbers, lines)
                lines.append(f"give {[numbers[result] for result in left]}")
        elif isinstance(value, Call):
            lines.append(f"call {args} {digest(value.program)}")
        else:
            data = value.data.hex() if value.op == "const" and value.type in FLOATS else value.data
            lines.append(f"{value.op} {value.type} {args} {data}")


@functools.cache
def _sources() -> bytes:
    """Return a digest of this package's sources, since a change of the code generator invalidates cached code."""
    sha = hashlib.sha256()
    for path in sorted(Path(__file__).parent.rglob("*.py")):
        sha.update(path.read_bytes())
    return sha.digest()


class NoNativeCodeError(DefinitionError):
    """A function cannot become native code, for example because of one of its operations or data types.

    JAX itself may be able to run the function.
    """


@contextmanager
def as_native_code_error(what: Callable[[], str]) -> Iterator[None]:
    """Convert every exception in the `with` block, except a DefinitionError, to a NoNativeCodeError.

    - `what`: function that returns the name of the compiled object, for the message.

    Raises NoNativeCodeError.
    """
    try:
        yield
    except DefinitionError:
        raise
    except Exception as error:
        reason = str(error).strip().partition("\n")[0]
        if not isinstance(error, NotImplementedError):
            reason = f"{type(error).__name__}{reason and ': '}{reason}"
        raise NoNativeCodeError(f"no native code for {what()}: {reason}") from error
