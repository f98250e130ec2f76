"""Expressions of xacro files, evaluated without Python's own evaluator: a file cannot run code by them."""

from __future__ import annotations

import ast
import math
import operator
import re
from collections.abc import Callable, Mapping
from typing import Any

LONGEST = 100_000
"""Characters of a text, entries of a list, and steps of a loop."""

MOST_BITS = 4096
"""Of a power of integers."""

MATHEMATICS = {
    name: function
    for name, function in vars(math).items()
    if callable(function) and name[0] != "_" and name not in ("factorial", "comb", "perm")
}
"""Functions of one or two numbers; of the others the value can be of any length."""

BUILTINS = (
    *(bool, int, float, str, list, tuple, dict, set, len, min, max, abs, round, sum, sorted, reversed, zip, enumerate),
    *(all, any, divmod, isinstance, repr),
)

METHODS: Mapping[type, tuple[str, ...]] = {
    str: ("split", "strip", "join", "replace", "lower", "upper", "startswith", "endswith", "title", "count", "find"),
    list: ("index", "count"),
    tuple: ("index", "count"),
    dict: ("get", "keys", "values", "items"),
}

OPERATORS: Mapping[type, Callable[[Any, Any], Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Div: operator.truediv,
    ast.FloorDiv: operator.floordiv,
    ast.Eq: operator.eq,
    ast.NotEq: operator.ne,
    ast.Lt: operator.lt,
    ast.LtE: operator.le,
    ast.Gt: operator.gt,
    ast.GtE: operator.ge,
    ast.Is: operator.is_,
    ast.IsNot: operator.is_not,
    ast.In: lambda one, others: one in others,
    ast.NotIn: lambda one, others: one not in others,
}

SIGNS: Mapping[type, Callable[[Any], Any]] = {ast.USub: operator.neg, ast.UAdd: operator.pos, ast.Not: operator.not_}


class ExpressionError(ValueError):
    """An expression has something that is not evaluated."""


def limited_range(*ends: int) -> range:
    """Return a range that is not longer than a file needs.

    - `ends`: as of `range`.
    """
    found = range(*ends)
    if len(found) > LONGEST:
        raise ExpressionError(f"a range of {len(found)} is longer than {LONGEST}")
    return found


SAFE = frozenset({*BUILTINS, limited_range, *MATHEMATICS.values()})
"""What an expression may call; it is compared by identity."""


def evaluate(text: str, names: Mapping[str, Any], functions: Mapping[str, Callable[..., Any]]) -> Any:
    """Return the value of an expression.

    - `text`: numbers, texts, lists, arithmetic, comparisons, conditions, indices, comprehensions and calls.
    - `names`: values by name; a mapping among them has its entries as attributes.
    - `functions`: what may be called by name, also in a namespace such as `xacro`, in addition to `math` and some of
      Python's own.

    Raises ExpressionError for anything else.
    """
    try:
        tree = ast.parse(text.strip(), mode="eval")
    except (SyntaxError, ValueError, MemoryError, RecursionError) as error:
        raise ExpressionError(f"no expression: {error}") from error
    return _Evaluation(names, functions).value(tree.body)


class _Evaluation:
    def __init__(self, names: Mapping[str, Any], functions: Mapping[str, Callable[..., Any]]) -> None:
        self.names, self.functions, self.local, self.steps = names, functions, dict[str, Any](), 0

    def value(self, node: ast.expr) -> Any:
        self.steps += 1
        if self.steps > LONGEST:
            raise ExpressionError(f"more than {LONGEST} steps")
        method = getattr(self, f"_{type(node).__name__.lower()}", None)
        if method is None:
            raise ExpressionError(f"`{type(node).__name__}` is not evaluated")
        found = method(node)
        if isinstance(found, str | list | tuple | dict | set) and len(found) > LONGEST:
            raise ExpressionError(f"a value of {len(found)} entries is longer than {LONGEST}")
        return found

    def _constant(self, node: ast.Constant) -> Any:
        return node.value

    def _name(self, node: ast.Name) -> Any:
        if node.id in self.local:
            return self.local[node.id]
        found = self.names[node.id]
        return self._function(node.id) if callable(found) else found

    def _function(self, name: str, found: Any = None) -> Any:
        if name in self.functions:
            return self.functions[name]
        own = {"range": limited_range, **{f.__name__: f for f in BUILTINS}, **MATHEMATICS}.get(name, found)
        if name.startswith("_") or not any(own is safe for safe in SAFE):
            raise ExpressionError(f"`{name}` is not called")
        return own

    def _attribute(self, node: ast.Attribute) -> Any:
        if node.attr.startswith("_"):
            raise ExpressionError(f"`{node.attr}` is not read")
        owner = self.value(node.value)
        if not isinstance(owner, Mapping):
            raise ExpressionError(f"`{node.attr}` of a {type(owner).__name__} is not read")
        found = owner[node.attr]
        return self._function(node.attr, found) if callable(found) else found

    def _call(self, node: ast.Call) -> Any:
        given = [self.value(one) for one in node.args]
        named = {one.arg: self.value(one.value) for one in node.keywords if one.arg}
        if len(named) < len(node.keywords):
            raise ExpressionError("`**` is not evaluated")
        if isinstance(node.func, ast.Attribute):
            owner = self.value(node.func.value)
            for kind, methods in METHODS.items():
                if isinstance(owner, kind) and node.func.attr in methods and node.func.attr not in _entries(owner):
                    if node.func.attr in ("replace", "join"):
                        self._refuse_long(owner, *given)
                    return getattr(owner, node.func.attr)(*given, **named)
        elif not isinstance(node.func, ast.Name):
            raise ExpressionError("only a function by its name is called")
        called = self.value(node.func)
        if not callable(called):
            raise ExpressionError("this is not called, as it is no function")
        return called(*given, **named)

    def _refuse_long(self, *texts: Any) -> None:
        sizes = [len(one) for one in texts if isinstance(one, str | list | tuple)]
        if math.prod(size + 1 for size in sizes) > LONGEST:
            raise ExpressionError("the texts are too long")

    def _binop(self, node: ast.BinOp) -> Any:
        left, right = self.value(node.left), self.value(node.right)
        kind = type(node.op)
        if kind is ast.Pow:
            whole = isinstance(left, int) and isinstance(right, int)
            numbers = isinstance(left, int | float) and isinstance(right, int | float)
            if not numbers or (whole and left.bit_length() * right > MOST_BITS):
                raise ExpressionError(f"a power must be of numbers, and an integer have at most {MOST_BITS} bits")
            return left**right
        if kind is ast.Mult:
            for one, other in ((left, right), (right, left)):
                if isinstance(one, str | list | tuple) and isinstance(other, int) and len(one) * other > LONGEST:
                    raise ExpressionError(f"a product of {len(one) * other} entries is longer than {LONGEST}")
            return left * right
        if kind is ast.Mod:
            if isinstance(left, str) and re.search(r"\d{4}|\*", left):
                raise ExpressionError("the format is too wide")
            return left % right
        if kind not in OPERATORS:
            raise ExpressionError(f"`{kind.__name__}` is not evaluated")
        return OPERATORS[kind](left, right)

    def _unaryop(self, node: ast.UnaryOp) -> Any:
        if type(node.op) not in SIGNS:
            raise ExpressionError(f"`{type(node.op).__name__}` is not evaluated")
        return SIGNS[type(node.op)](self.value(node.operand))

    def _boolop(self, node: ast.BoolOp) -> Any:
        found: Any = None
        for one in node.values:
            found = self.value(one)
            if bool(found) is isinstance(node.op, ast.Or):
                break
        return found

    def _compare(self, node: ast.Compare) -> Any:
        left = self.value(node.left)
        for kind, one in zip(node.ops, node.comparators, strict=True):
            right = self.value(one)
            if not OPERATORS[type(kind)](left, right):
                return False
            left = right
        return True

    def _ifexp(self, node: ast.IfExp) -> Any:
        return self.value(node.body if self.value(node.test) else node.orelse)

    def _subscript(self, node: ast.Subscript) -> Any:
        return self.value(node.value)[self.value(node.slice)]

    def _slice(self, node: ast.Slice) -> Any:
        return slice(*(None if one is None else self.value(one) for one in (node.lower, node.upper, node.step)))

    def _list(self, node: ast.List) -> Any:
        return [self.value(one) for one in node.elts]

    def _tuple(self, node: ast.Tuple) -> Any:
        return tuple(self.value(one) for one in node.elts)

    def _set(self, node: ast.Set) -> Any:
        return {self.value(one) for one in node.elts}

    def _dict(self, node: ast.Dict) -> Any:
        if any(key is None for key in node.keys):
            raise ExpressionError("`**` is not evaluated")
        return {self.value(key): self.value(one) for key, one in zip(node.keys, node.values, strict=True) if key}

    def _listcomp(self, node: ast.ListComp | ast.GeneratorExp) -> Any:
        if len(node.generators) != 1 or not isinstance(node.generators[0].target, ast.Name):
            raise ExpressionError("a comprehension must have one loop over one name")
        loop, before, found = node.generators[0], dict(self.local), []
        name = loop.target.id  # type: ignore[attr-defined]  # a name, as was looked at
        for one in self.value(loop.iter):
            self.local[name] = one
            if all(self.value(test) for test in loop.ifs):
                found.append(self.value(node.elt))
        self.local = before
        return found

    _generatorexp = _listcomp


def _entries(owner: Any) -> Mapping[str, Any]:
    return owner if isinstance(owner, Mapping) else {}
