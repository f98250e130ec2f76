"""Statements and docstrings of the Python source that a value comes from, in plain ASCII."""

from __future__ import annotations

import ast
import functools
import itertools
import re
import unicodedata
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

ACCENTS = {"DOT ABOVE": "d", "DIAERESIS": "dd", "MACRON": "_bar", "CIRCUMFLEX ACCENT": "_hat", "TILDE": "_tilde"}
"""Replacements of accents: dots of a derivative go before the letter, the others after it."""

SIGNS = {
    "⁻": "-",
    "‖": "|",
    "≤": "<=",
    "≥": ">=",
    "≠": "!=",
    "≈": "~",
    "·": " ",
    "×": "x",
    "±": "+-",
    "√": "sqrt",
    "∫": "integral ",
    "∂": "d",
    "∈": "in",
    "→": "->",
    "∞": "inf",
    "′": "'",
    "°": " deg",
    "⁄": "/",
    "–": "-",
    "−": "-",
    "“": '"',
    "”": '"',
    "’": "'",
}
SHORT = {"epsilon": "eps", "lamda": "lambda"}


def to_ascii(text: str) -> str:
    """Transliterate a text to ASCII: τ is tau, ε̇ is deps, x² is x^2, ρ∞ is rho_inf; unknown characters become `?`."""
    text = text.replace("⃛", "\u0308\u0307")
    text = re.sub(r"(?<=\w)∞", "_inf", text)
    text = re.sub(r"([⁻⁰¹²³⁴-⁹ˣᵃ-ᵿᵀⁿ]+)(\w?)", lambda match: f"^{match[1]} {match[2]}".rstrip(" "), text)
    parts: list[str] = []
    for letter in unicodedata.normalize("NFKD", text):
        name = unicodedata.name(letter, "")
        if unicodedata.combining(letter) and parts:
            accent = ACCENTS.get(name.removeprefix("COMBINING "), "")
            parts[-1] = parts[-1] + accent if accent.startswith("_") else accent + parts[-1]
        else:
            parts.append(_greek(name) if name.startswith("GREEK ") else SIGNS.get(letter, letter))
    spaced = parts[:1]
    for before, part in itertools.pairwise(parts):
        # A letter that became a word needs a space before its neighbour.
        runs_on = max(len(before), len(part)) > 1 and before[-1:].isalpha() and part[:1].isalpha()
        spaced.append(f" {part}" if runs_on else part)
    return re.sub(r"[^\x20-\x7e]", "?", "".join(spaced))


def _greek(name: str) -> str:
    word = name.split()[3 if "LETTER" in name else 1].lower()
    word = SHORT.get(word, word)
    return word.capitalize() if "CAPITAL" in name else word


IDENTITIES = frozenset({"barrier", "asarray"})
"""Functions that return their argument."""

STACKS = frozenset({"array", "stack", "asarray"})
"""Functions that convert a list to an array."""

Span = tuple[int, int, int, int]


class Returned(NamedTuple):
    """Place of a value in the result of a function.

    - `position`: index in the returned tuple; None if the function does not return a tuple.
    - `path`: indices of the value in nested lists, from the outermost one, if the source converts these to an array.
    """

    position: int | None = None
    path: tuple[int, ...] = ()


class Named(NamedTuple):
    """A value that the source assigns to a variable.

    - `path`: as in `Returned`.
    """

    name: str
    path: tuple[int, ...]


class SourceFile:
    """A Python source file, parsed from its text."""

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
        """Return the expression at a source location, an object with `line`, `column`, `end_line` and `end_column`."""
        return self._at.get((frame.line, frame.column, frame.end_line, frame.end_column))

    def fate(self, node: ast.expr, value: Returned) -> Named | Returned | None:
        """Return the variable to which the source assigns an expression's value, or its place in a function's result.

        Returns None if neither applies, for example if a larger expression uses the value.

        - `node`: the expression.
        - `value`: place of the value to look for in the expression's value.
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

    def docs(self, line: int) -> list[tuple[str, str]]:
        """Return (name, first docstring line) of the innermost function around a line, and of its class for a method.

        The list is empty outside functions. The first docstring line is empty if there is no docstring.
        """
        around = [node for node in self._functions if node.lineno <= line <= (node.end_lineno or 0)]
        if not around:
            return []
        function = max(around, key=lambda node: node.lineno)
        owner = self._parents[function]
        if not isinstance(owner, ast.ClassDef):
            return [(function.name, _summary(function))]
        return [(f"{owner.name}.{function.name}", _summary(function)), (owner.name, _summary(owner))]


@functools.cache
def read_source(file: str) -> SourceFile | None:
    """Read and parse a file, once; None if it cannot be read, as in a notebook."""
    try:
        return SourceFile(Path(file).read_text(encoding="utf-8"))
    except (OSError, SyntaxError, ValueError):
        return None


def function_called(call: ast.Call) -> str:
    """Return the name of the called function, without its module."""
    function = call.func
    return function.attr if isinstance(function, ast.Attribute) else getattr(function, "id", "")


def operand(node: ast.expr) -> str | None:
    """Return the name of an operand: `x` for `x`, `slope` for `error.slope`; None for other expressions."""
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


def about(frames: Sequence[Any]) -> str:
    """Return a comment, `name: first docstring line`, from the innermost function with a formula in this line.

    A formula is a text in backticks, or an equation number. The comment is empty if no function has one. For a method,
    its class's line is used if it has more of these: text in backticks, an equals sign there, an equation number.

    - `frames`: source locations (function calls) that lead to a value, the innermost first.
    """
    return next(filter(None, (_about(frame.file, frame.line) for frame in frames)), "")


@functools.lru_cache(4096)
def _about(file: str, line: int) -> str:
    text = read_source(file)
    docs = [] if text is None else text.docs(line)
    if not docs:
        return ""
    # The method comes first, so it wins a tie.
    name, summary = max(docs, key=lambda of: _formulas(of[1]))
    if not _formulas(summary):
        return ""
    return f"{name.removesuffix('.__call__')}: {to_ascii(summary).replace('`', '').rstrip('.')}"


def _formulas(summary: str) -> int:
    formulas = "".join(summary.split("`")[1::2])
    return bool(formulas) + ("=" in formulas) + ("eq. (" in summary or "qs. (" in summary)
