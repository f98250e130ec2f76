"""What a source file says of the place that a value came from: what it is assigned to, and what its function is for."""

from __future__ import annotations

import ast
import functools
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

IDENTITIES = frozenset({"once", "asarray"})
"""Functions that return what they are given."""

STACKS = frozenset({"array", "stack", "asarray"})
"""Functions that make an array of a list."""

Span = tuple[int, int, int, int]


class Returned(NamedTuple):
    """A value on its way out of the functions that computed it.

    - `position`: in the tuple that is returned; None: it is returned alone.
    - `path`: in lists that became arrays, the outermost index first.
    """

    position: int | None = None
    path: tuple[int, ...] = ()


class Named(NamedTuple):
    """A name that a value got.

    - `name`: as in the source.
    - `path`: as in `Returned`.
    """

    name: str
    path: tuple[int, ...]


@dataclass(frozen=True)
class Docs:
    """What a function is for.

    - `name`: of the function, with its class.
    - `summary`: the first line of its docstring; empty if it has none.
    - `owner`: the class; empty outside of classes.
    - `owner_summary`: the first line of the class's docstring.
    """

    name: str
    summary: str
    owner: str
    owner_summary: str


class Source:
    """A file of Python.

    - `text`: what is in it.
    """

    def __init__(self, text: str) -> None:
        self._parents: dict[ast.AST, ast.AST] = {}
        self._at: dict[Span, ast.expr] = {}
        self._functions: list[ast.FunctionDef] = []
        for node in ast.walk(ast.parse(text)):
            for child in ast.iter_child_nodes(node):
                self._parents[child] = node
            if isinstance(node, ast.expr):
                self._at[(node.lineno, node.col_offset, node.end_lineno or 0, node.end_col_offset or 0)] = node
            elif isinstance(node, ast.FunctionDef):
                self._functions.append(node)

    def at(self, frame: Any) -> ast.expr | None:
        """The expression at a place.

        - `frame`: the place, with `line`, `column`, `end_line`, `end_column`.
        """
        return self._at.get((frame.line, frame.column, frame.end_line, frame.end_column))

    def fate(self, node: ast.expr, value: Returned) -> Named | Returned | None:
        """What becomes of what an expression gives: a name, or it is returned; None if it is used up in a larger one.

        - `node`: the expression.
        - `value`: which part of it.
        """
        position, path = value
        inner: ast.AST = node
        while True:
            outer = self._parents[inner]
            if isinstance(outer, (ast.Return, ast.Lambda)):
                return Returned(position, path)
            if isinstance(outer, (ast.Assign, ast.AnnAssign, ast.NamedExpr)):
                target = outer.targets[0] if isinstance(outer, ast.Assign) else outer.target
                return _assigned(target, position, path)
            if isinstance(outer, ast.keyword):
                call = self._parents[outer]
                if position is None and outer.arg and isinstance(call, ast.Call) and _is_class(call):
                    return Named(outer.arg, path)
                return None
            if isinstance(outer, ast.Dict):
                return _entry(outer, inner, path) if position is None else None
            if isinstance(outer, ast.Tuple) and position is None:
                position = outer.elts.index(inner)  # type: ignore[arg-type]
            elif isinstance(outer, ast.List) and position is None:
                path = (outer.elts.index(inner), *path)  # type: ignore[arg-type]
            elif isinstance(outer, ast.Subscript) and inner is outer.value:
                if not isinstance(outer.slice, ast.Constant) or outer.slice.value != position:
                    return None
                position = None
            elif isinstance(outer, ast.Call) and outer.args and inner is outer.args[0]:
                allowed = STACKS if path else IDENTITIES
                if function_called(outer) not in allowed:
                    return None
            elif not (isinstance(outer, ast.IfExp) and inner is not outer.test):
                return None
            inner = outer

    def docs(self, line: int) -> Docs | None:
        """What the innermost function around a line is for; None outside of functions.

        - `line`: its number.
        """
        around = [node for node in self._functions if node.lineno <= line <= (node.end_lineno or 0)]
        if not around:
            return None
        function = max(around, key=lambda node: node.lineno)
        owner = self._parents[function]
        if not isinstance(owner, ast.ClassDef):
            return Docs(function.name, _summary(function), "", "")
        return Docs(f"{owner.name}.{function.name}", _summary(function), owner.name, _summary(owner))


@functools.cache
def source(file: str) -> Source | None:
    """A file, read once; None if it cannot be read, as in a notebook.

    - `file`: its path.
    """
    try:
        return Source(Path(file).read_text(encoding="utf-8"))
    except (OSError, SyntaxError, ValueError):
        return None


def function_called(call: ast.Call) -> str:
    """The name of the function that is called, without its module.

    - `call`: the call.
    """
    function = call.func
    return function.attr if isinstance(function, ast.Attribute) else getattr(function, "id", "")


def operand(node: ast.expr) -> str | None:
    """The name of an operand that has one: `x`, or `slope` for `error.slope`.

    - `node`: the operand.
    """
    if isinstance(node, ast.Name):
        return node.id
    return node.attr if isinstance(node, ast.Attribute) else None


def _is_class(call: ast.Call) -> bool:
    return function_called(call).lstrip("_")[:1].isupper()


def _assigned(target: ast.expr, position: int | None, path: tuple[int, ...]) -> Named | None:
    if position is not None:
        if not isinstance(target, ast.Tuple) or position >= len(target.elts):
            return None
        target = target.elts[position]
    return Named(target.id, path) if isinstance(target, ast.Name) else None


def _entry(entries: ast.Dict, value: ast.AST, path: tuple[int, ...]) -> Named | None:
    key = entries.keys[entries.values.index(value)]  # type: ignore[arg-type]
    return Named(key.value, path) if isinstance(key, ast.Constant) and isinstance(key.value, str) else None


def _summary(node: ast.FunctionDef | ast.ClassDef) -> str:
    return (ast.get_docstring(node) or "").partition("\n")[0].strip()
