"""Origin of a value: its place in the Python source."""

from __future__ import annotations

import functools
import itertools
import math
import os
from types import CodeType
from typing import Any, NamedTuple

import jax

HERE = os.path.dirname(__file__)
LIBRARIES = tuple(f"{os.sep}{name}{os.sep}" for name in ("jax", "equinox", "jaxtyping", "beartype"))


class SourceFrame(NamedTuple):
    """An expression in a source file.

    - `file`, `line`: start of the expression.
    - `function`: qualified name of the surrounding function.
    - `column`, `end_line`, `end_column`: start and end within the lines, in bytes as `ast` counts them.
    """

    file: str
    line: int
    function: str
    column: int = 0
    end_line: int = 0
    end_column: int = 0


class Origin:
    """Place in the source of a value.

    - `equation`: equation of the jaxpr.
    - `element`: number of the value in the equation's result, in C order; None if it is no element of it.
    - `shape`: shape of that result.
    - `visit`: equal for the values of one operation on arrays.
    - `within`: name of the function in which the place is looked for; None: anywhere.
    """

    __slots__ = ("element", "equation", "shape", "visit", "within")

    def __init__(
        self,
        equation: Any,
        element: int | None = None,
        shape: tuple[int, ...] = (),
        within: str | None = None,
        visit: object = None,
    ) -> None:
        self.equation = equation
        self.element = element
        self.shape = shape
        self.within = within
        self.visit: object = self if visit is None else visit

    @property
    def size(self) -> int:
        """Number of elements of the result."""
        return math.prod(self.shape)

    @property
    def frames(self) -> list[SourceFrame]:
        """Places in the source, the innermost first, without JAX and its libraries."""
        frames = frames_of(self.equation)
        for k, frame in enumerate(frames):
            if self.within is not None and frame.function.rpartition(".")[2] == self.within:
                return frames[: k + 1]
        return frames


def frames_of(equation: Any) -> list[SourceFrame]:
    """Return the places in the source of an equation, the innermost first."""
    traceback = equation.source_info.traceback
    frames: list[SourceFrame] = []
    for code, instruction in zip(*traceback.raw_frames(), strict=True) if traceback is not None else ():
        if code.co_filename.startswith(HERE):
            # Callers of the tracer do not belong to the traced function.
            break
        if _ours(code.co_filename):
            frames.append(_place(code, instruction))
    return frames


@functools.lru_cache(10_000)
def _place(code: CodeType, instruction: int) -> SourceFrame:
    positions = next(itertools.islice(code.co_positions(), instruction // 2, None))
    line, end_line, column, end_column = (number or 0 for number in positions)
    return SourceFrame(code.co_filename, line, code.co_qualname, column, end_line, end_column)


@functools.cache
def _ours(file: str) -> bool:
    inside = os.path.dirname(os.path.dirname(jax.__file__))
    if file.startswith(inside) and any(name in file[len(inside) :] for name in LIBRARIES):
        return False
    return not file.startswith("<frozen")
