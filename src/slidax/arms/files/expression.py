"""Evaluate expressions of xacro files without Python's own `eval`, so that a file cannot run code."""

from __future__ import annotations

import ast
import math
import operator
import re
from collections.abc import Callable, ItemsView, Iterable, KeysView, Mapping, ValuesView
from itertools import islice
from typing import Any

LONGEST = 100_000
"""Most characters in a string, entries in a list, and steps in a loop."""

LONGEST_PRINTED = 5_000_000
"""Most characters that an argument or a result has as text; an entry that occurs several times counts several times."""

MOST_BITS = 4096
"""Most bits in an integer."""

MOST_STEPS = 5_000_000
"""Most steps in an expansion, of about 1 µs each; the manufacturer's UR5e takes 100 000."""

CHARACTERS = 100
"""Number of characters that count as one step."""

MATHEMATICS = {
    name: function
    for name, function in vars(math).items()
    if callable(function) and name[0] != "_" and name not in ("factorial", "comb", "perm", "prod", "lcm")
}
"""Functions of one or two numbers, without those whose value can have any length."""

BUILTINS = (
    *(bool, int, float, str, list, tuple, dict, set, len, min, max, abs, sorted, reversed, zip, enumerate),
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
    ast.In: lambda entry, entries: entry in entries,
    ast.NotIn: lambda entry, entries: entry not in entries,
}

SIGNS: Mapping[type, Callable[[Any], Any]] = {ast.USub: operator.neg, ast.UAdd: operator.pos, ast.Not: operator.not_}


class ExpressionError(ValueError):
    """An expression of a xacro file is invalid, too long, or has a part that is not supported."""


class Budget:
    """Counts the steps of an expansion, so that endless repetition ends with an error."""

    def __init__(self) -> None:
        self.left = MOST_STEPS

    def spend(self, steps: int) -> None:
        """Subtract steps, of about a microsecond each, from the budget; raise ExpressionError if none are left."""
        self.left -= steps
        if self.left < 0:
            raise ExpressionError(
                f"it takes more than {MOST_STEPS} steps; does a macro, an include or a property repeat itself? If not, "
                "expand it by `xacro FILE > robot.urdf`"
            )

    def spend_on(self, value: Any) -> None:
        """Count a step for a value and for each of its entries; raise ExpressionError if none are left.

        An entry that occurs several times counts several times.
        """
        waiting = [value]
        while waiting:
            entry = waiting.pop()
            self.spend(1 + len(entry) // CHARACTERS if isinstance(entry, str) else 1)
            if isinstance(entry, Mapping):
                waiting.extend((*entry.keys(), *entry.values()))
            elif isinstance(entry, list | tuple | set):
                waiting.extend(entry)


def limited_range(*ends: int) -> range:
    """Return a range of integers; raise ExpressionError if it has more than `LONGEST` values."""
    steps = range(*ends)
    if len(steps) > LONGEST:
        raise ExpressionError(f"a range of {len(steps)} values exceeds the limit of {LONGEST}")
    return steps


def limited_round(number: Any, digits: int | None = None) -> Any:
    """Return a rounded number; limit the digits, since rounding an integer to -10⁹ digits computes 10^(10⁹)."""
    if digits is not None and abs(digits) > MOST_BITS:
        raise ExpressionError(f"cannot round a number to {digits} digits, which is too many")
    return round(number, digits)


def add_numbers(numbers: Iterable[Any], start: Any = 0) -> Any:
    """Return a sum of numbers; reject lists, since adding many of them would copy each one many times."""
    terms = [start, *numbers]
    if not all(isinstance(term, int | float) for term in terms):
        raise ExpressionError("`sum` adds only numbers")
    return sum(terms)


LIMITED: Mapping[str, Callable[..., Any]] = {"range": limited_range, "round": limited_round, "sum": add_numbers}

SAFE = frozenset({*BUILTINS, *LIMITED.values(), *MATHEMATICS.values()})
"""Functions that an expression may call; the comparison is by identity."""


def evaluate(
    text: str, names: Mapping[str, Any], functions: Mapping[str, Callable[..., Any]], budget: Budget | None = None
) -> Any:
    """Return the value of an expression of a xacro file, such as `2*radius` or `arm.links[0]`.

    - `text`: numbers, strings, lists, arithmetic, comparisons, conditions, indices, comprehensions and calls.
    - `names`: values by name; a mapping's entries are read as attributes, such as `arm.links`.
    - `functions`: functions by name that the expression may call, in addition to those of `math` and some built-ins.
    - `budget`: step budget of the file's expansion; a new one by default.

    Raises ExpressionError for any other syntax or function, and for a result that exceeds a limit. Errors of the
    evaluation itself, such as a KeyError for an unknown name, pass through.
    """
    try:
        tree = ast.parse(text.strip(), mode="eval")
    except (SyntaxError, ValueError, MemoryError, RecursionError) as error:
        raise ExpressionError(f"not a valid expression: {error}") from error
    result = _Evaluation(names, functions, budget or Budget()).value(tree.body)
    # xacro writes a result into the text of an element or an attribute.
    _refuse_long(_printed_length(result), LONGEST_PRINTED)
    return result


class _Evaluation:
    def __init__(self, names: Mapping[str, Any], functions: Mapping[str, Callable[..., Any]], budget: Budget) -> None:
        self.names, self.functions, self.budget = names, functions, budget
        self.local, self.steps = dict[str, Any](), 0

    def value(self, node: ast.expr) -> Any:
        self.steps += 1
        if self.steps > LONGEST:
            raise ExpressionError(f"the expression takes more than {LONGEST} steps")
        method = getattr(self, f"_{type(node).__name__.lower()}", None)
        if method is None:
            raise ExpressionError(f"`{type(node).__name__}` is not supported in an expression")
        result = method(node)
        if isinstance(result, str | list | tuple | dict | set) and len(result) > LONGEST:
            raise ExpressionError(f"a text or list has {len(result)} characters or entries; the limit is {LONGEST}")
        if isinstance(result, int) and result.bit_length() > MOST_BITS:
            raise ExpressionError(f"an integer must have at most {MOST_BITS} bits")
        self.budget.spend_on(result)
        return result

    def _constant(self, node: ast.Constant) -> Any:
        if not isinstance(node.value, int | float | str | None):
            raise ExpressionError(f"a constant of type `{type(node.value).__name__}` is not supported")
        return node.value

    def _name(self, node: ast.Name) -> Any:
        if node.id in self.local:
            return self.local[node.id]
        named = self.names[node.id]
        return self._function(node.id) if callable(named) else named

    def _function(self, name: str, named: Any = None) -> Any:
        if name in self.functions:
            return self.functions[name]
        own = {**LIMITED, **{f.__name__: f for f in BUILTINS}, **MATHEMATICS}.get(name, named)
        if name.startswith("_") or not any(own is safe for safe in SAFE):
            raise ExpressionError(f"the function `{name}` is not supported")
        return own

    def _attribute(self, node: ast.Attribute) -> Any:
        if node.attr.startswith("_"):
            raise ExpressionError(f"the attribute `{node.attr}` is not supported")
        owner = self.value(node.value)
        if not isinstance(owner, Mapping):
            raise ExpressionError(f"the attribute `{node.attr}` of a {type(owner).__name__} is not supported")
        entry = owner[node.attr]
        return self._function(node.attr, entry) if callable(entry) else entry

    def _call(self, node: ast.Call) -> Any:
        arguments = [self.value(argument) for argument in node.args]
        options = {option.arg: self.value(option.value) for option in node.keywords if option.arg}
        if len(options) < len(node.keywords):
            raise ExpressionError("`**` is not supported in a call")
        if isinstance(node.func, ast.Attribute):
            owner = self.value(node.func.value)
            for kind, methods in METHODS.items():
                if isinstance(owner, kind) and node.func.attr in methods and node.func.attr not in _entries(owner):
                    if node.func.attr == "replace":
                        _refuse_long(math.prod(len(text) + 1 for text in (owner, *arguments) if isinstance(text, str)))
                    if node.func.attr == "join" and arguments and isinstance(owner, str):
                        arguments[0] = _entries_to_join(owner, arguments[0])
                    return getattr(owner, node.func.attr)(*arguments, **options)
        elif not isinstance(node.func, ast.Name):
            raise ExpressionError("only a function can be called, by its name")
        called = self.value(node.func)
        if not callable(called):
            raise ExpressionError("only a function can be called")
        # Functions such as `str` and `tokenize` write their arguments as text.
        for argument in (*arguments, *options.values()):
            _refuse_long(_printed_length(argument), LONGEST_PRINTED)
        return called(*arguments, **options)

    def _binop(self, node: ast.BinOp) -> Any:
        left, right = self.value(node.left), self.value(node.right)
        kind = type(node.op)
        if kind is ast.Pow:
            whole = isinstance(left, int) and isinstance(right, int)
            numbers = isinstance(left, int | float) and isinstance(right, int | float)
            if not numbers or (whole and left.bit_length() * right > MOST_BITS):
                raise ExpressionError(f"`**` needs two numbers, and an integer result of at most {MOST_BITS} bits")
            return left**right
        if kind is ast.Mult:
            for entries, times in ((left, right), (right, left)):
                if (
                    isinstance(entries, str | list | tuple)
                    and isinstance(times, int)
                    and len(entries) * times > LONGEST
                ):
                    raise ExpressionError(
                        f"a text or list repeated by `*` would have {len(entries) * times} characters or entries; "
                        f"the limit is {LONGEST}"
                    )
            return left * right
        if kind is ast.Mod:
            if isinstance(left, str) and re.search(r"\d{4}|\*", left):
                raise ExpressionError("a format before `%` must not have `*`, or a number of four or more digits")
            if isinstance(left, str):
                _refuse_long(_formatted_length(left, right))
            return left % right
        if kind not in OPERATORS:
            raise ExpressionError(f"the operator `{kind.__name__}` is not supported")
        return OPERATORS[kind](left, right)

    def _unaryop(self, node: ast.UnaryOp) -> Any:
        if type(node.op) not in SIGNS:
            raise ExpressionError(f"the operator `{type(node.op).__name__}` is not supported")
        return SIGNS[type(node.op)](self.value(node.operand))

    def _boolop(self, node: ast.BoolOp) -> Any:
        result: Any = None
        for operand in node.values:
            result = self.value(operand)
            if bool(result) is isinstance(node.op, ast.Or):
                break
        return result

    def _compare(self, node: ast.Compare) -> Any:
        left = self.value(node.left)
        for kind, other in zip(node.ops, node.comparators, strict=True):
            right = self.value(other)
            if not OPERATORS[type(kind)](left, right):
                return False
            left = right
        return True

    def _ifexp(self, node: ast.IfExp) -> Any:
        return self.value(node.body if self.value(node.test) else node.orelse)

    def _subscript(self, node: ast.Subscript) -> Any:
        return self.value(node.value)[self.value(node.slice)]

    def _slice(self, node: ast.Slice) -> Any:
        return slice(*(None if end is None else self.value(end) for end in (node.lower, node.upper, node.step)))

    def _list(self, node: ast.List) -> Any:
        return [self.value(entry) for entry in node.elts]

    def _tuple(self, node: ast.Tuple) -> Any:
        return tuple(self.value(entry) for entry in node.elts)

    def _set(self, node: ast.Set) -> Any:
        return {self.value(entry) for entry in node.elts}

    def _dict(self, node: ast.Dict) -> Any:
        if any(key is None for key in node.keys):
            raise ExpressionError("`**` is not supported in a dictionary")
        return {self.value(key): self.value(entry) for key, entry in zip(node.keys, node.values, strict=True) if key}

    def _listcomp(self, node: ast.ListComp | ast.GeneratorExp) -> Any:
        loop = node.generators[0]
        if len(node.generators) != 1 or not isinstance(loop.target, ast.Name):
            raise ExpressionError("a comprehension must have one loop over one name")
        before, results = dict(self.local), []
        for entry in self.value(loop.iter):
            self.local[loop.target.id] = entry
            if all(self.value(test) for test in loop.ifs):
                results.append(self.value(node.elt))
        self.local = before
        return results

    _generatorexp = _listcomp


def _refuse_long(characters: int, most: int = LONGEST) -> None:
    """Raise ExpressionError for a text that could have more than `most` characters, before it is built."""
    if characters > most:
        raise ExpressionError(f"a text could be too long, {characters} characters; the limit is {most}")


def _entries_to_join(separator: str, entries: Iterable[Any]) -> list[Any]:
    """Return the entries that `separator` joins, as a list; raise ExpressionError if their text would be too long."""
    parts = list(islice(entries, LONGEST + 1))
    _refuse_long(sum(len(part) + len(separator) for part in parts if isinstance(part, str)) - len(separator))
    return parts


def _printed_length(value: Any) -> int:
    """Estimate how many characters a value has as text; stop the count above `LONGEST_PRINTED`."""
    total, waiting = 0, [value]
    while waiting and total <= LONGEST_PRINTED:
        entry = waiting.pop()
        # Quotation marks and a comma, or brackets.
        total += 4
        if isinstance(entry, str):
            total += len(entry)
        elif isinstance(entry, int):
            total += entry.bit_length() // 3
        elif isinstance(entry, float):
            # `%f` writes all digits of a large number.
            total += 24 if abs(entry) < 1e16 else 320
        elif isinstance(entry, Mapping):
            waiting.extend((*entry.keys(), *entry.values()))
        elif isinstance(entry, list | tuple | set | KeysView | ValuesView | ItemsView):
            waiting.extend(entry)
    return total


def _formatted_length(form: str, values: Any) -> int:
    """Estimate how many characters `form % values` has, at most."""
    count, widest = form.count("%"), max(map(int, re.findall(r"\d+", form)), default=0)
    if not isinstance(values, Mapping):
        return len(form) + _printed_length(values) + count * widest
    # A conversion without a key, such as `%s`, writes the whole mapping.
    entries = [values] if re.search(r"%(?![(%])", form) else list(values.values())
    return len(form) + count * (max(map(_printed_length, entries), default=0) + widest)


def _entries(owner: Any) -> Mapping[str, Any]:
    return owner if isinstance(owner, Mapping) else {}
