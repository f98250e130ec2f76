"""Constant folding and algebraic simplification of single operations."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from .ir import DTYPES, FLOATS, Number, Type, Value

if TYPE_CHECKING:
    from .builder import Builder

Rule = Callable[["Builder", Type, tuple[Value, ...]], Value | None]
"""Map a builder, an operation's result type and its arguments to a simpler equal value; None if there is none."""

# Elementary functions such as exp are absent, since their last digits in NumPy differ between machines.
_COMPUTE: dict[str, Callable[..., Any]] = {
    "add": np.add,
    "sub": np.subtract,
    "mul": np.multiply,
    "neg": np.negative,
    "abs": np.abs,
    "min": np.minimum,
    "max": np.maximum,
    "sqrt": np.sqrt,
    "floor": np.floor,
    "ceil": np.ceil,
    "rint": np.rint,
    "and": np.bitwise_and,
    "or": np.bitwise_or,
    "xor": np.bitwise_xor,
    "eq": np.equal,
    "ne": np.not_equal,
    "lt": np.less,
    "le": np.less_equal,
    "gt": np.greater,
    "ge": np.greater_equal,
    "isfinite": np.isfinite,
}
_EQUAL_GIVES = {"eq": True, "le": True, "ge": True, "ne": False, "lt": False, "gt": False}


def fold_operation(builder: Builder, op: str, type: Type, args: tuple[Value, ...]) -> Value | None:
    """Return a simpler IR value that equals the result of an operation, or None if there is none.

    - `op`, `args`: operation and operands.
    - `type`: type of the result.
    """
    if op == "select" and args[0].op == "const":
        return args[1] if args[0].data else args[2]
    if args and all(arg.op == "const" for arg in args):
        number = _compute(op, type, args)
        if number is not None:
            return builder.constant(number, type)
    rule = _RULES.get(op)
    return rule(builder, type, args) if rule is not None else None


def _compute(op: str, type: Type, args: tuple[Value, ...]) -> Number | None:
    numbers = [DTYPES[arg.type](arg.data) for arg in args]
    with np.errstate(all="ignore"):
        if op == "convert":
            return convert_number(args[0].data, args[0].type, type)
        if op == "bitcast":
            return np.asarray(numbers[0]).view(DTYPES[type]).item()
        if op == "not":
            return (not args[0].data) if type == "b1" else np.invert(numbers[0]).item()
        if op in ("div", "rem"):
            return _divide(op, type, numbers)
        if op in ("shl", "shr", "sar"):
            return _shift(op, type, *(int(arg.data) for arg in args))
        compute = _COMPUTE.get(op)
        return None if compute is None else np.asarray(compute(*numbers)).item()


def _divide(op: str, type: Type, numbers: list[Any]) -> Number | None:
    if type not in FLOATS and numbers[1] == 0:
        return None
    rest = np.fmod(*numbers)
    if op == "rem":
        return rest.item()
    if type in FLOATS:
        return np.divide(*numbers).item()
    return int((numbers[0] - rest) // numbers[1])


def _shift(op: str, type: Type, number: int, distance: int) -> Number:
    bits = np.iinfo(DTYPES[type]).bits
    if not 0 <= distance < bits:
        return -1 if op == "sar" and number < 0 else 0
    operand = number if op == "sar" else number & ((1 << bits) - 1)
    return convert_number(operand >> distance if op != "shl" else operand << distance, "u64", type)


def convert_number(number: Number, source: Type, target: Type) -> Number:
    """Return a Python number converted from the IR type `source` to `target`, as generated code does it.

    A conversion from floats to integers rounds towards zero and saturates, and NaN becomes 0. A conversion between
    integers wraps around.
    """
    if target == "b1":
        return bool(number)
    if target in FLOATS:
        return float(DTYPES[target](number))
    if source in FLOATS:
        if math.isnan(number):
            return 0
        ends = np.iinfo(DTYPES[target])
        return (
            int(max(ends.min, min(ends.max, number)))
            if math.isfinite(number)
            else (int(ends.max) if number > 0 else int(ends.min))
        )
    return int(np.asarray(int(number) & 0xFFFFFFFFFFFFFFFF, np.uint64).astype(DTYPES[target]))


def _is(value: Value, number: Number) -> bool:
    return value.op == "const" and value.data == number


def _add(b: Builder, type: Type, args: tuple[Value, ...]) -> Value | None:
    x, y = args
    if _is(x, 0):
        return y
    if _is(y, 0):
        return x
    if y.op == "neg":
        return b.apply("sub", x, y.args[0])
    if x.op == "neg":
        return b.apply("sub", y, x.args[0])
    return None


def _sub(b: Builder, type: Type, args: tuple[Value, ...]) -> Value | None:
    x, y = args
    if _is(y, 0):
        return x
    if _is(x, 0):
        return b.apply("neg", y)
    return b.apply("add", x, y.args[0]) if y.op == "neg" else None


def _mul(b: Builder, type: Type, args: tuple[Value, ...]) -> Value | None:
    for x, y in (args, args[::-1]):
        if _is(x, 1):
            return y
        if _is(x, -1):
            return b.apply("neg", y)
    return None


def _div(b: Builder, type: Type, args: tuple[Value, ...]) -> Value | None:
    return args[0] if _is(args[1], 1) else None


def _undo(op: str) -> Rule:
    return lambda b, type, args: args[0].args[0] if args[0].op == op else None


def _abs(b: Builder, type: Type, args: tuple[Value, ...]) -> Value | None:
    if args[0].op == "neg":
        return b.apply("abs", args[0].args[0])
    return args[0] if args[0].op == "abs" else None


def _same(b: Builder, type: Type, args: tuple[Value, ...]) -> Value | None:
    return args[0] if args[0] is args[1] else None


def _logical(decides: bool) -> Rule:
    """Return the rule of `and` or `or`.

    - `decides`: operand that alone decides the result: False for `and`, True for `or`.
    """

    def rule(b: Builder, type: Type, args: tuple[Value, ...]) -> Value | None:
        for x, y in (args, args[::-1]):
            if _is(x, 0) or (x.op == "const" and type == "b1"):
                return x if bool(x.data) is decides else y
        return _same(b, type, args)

    return rule


def _xor(b: Builder, type: Type, args: tuple[Value, ...]) -> Value | None:
    return b.constant(0, type) if args[0] is args[1] else None


def _select(b: Builder, type: Type, args: tuple[Value, ...]) -> Value | None:
    when, yes, no = args
    if yes is no:
        return yes
    if when.op == "not":
        return b.apply("select", when.args[0], no, yes)
    if type == "b1":
        for value, other, op in ((yes, no, "or"), (no, yes, "and")):
            if value.op == "const":
                # yes = true: when or no; no = false: when and yes
                if op == "or" and value.data:
                    return b.apply("or", when, other)
                if op == "and" and not value.data:
                    return b.apply("and", when, other)
    # Nested choices on the same condition collapse.
    if yes.op == "select" and yes.args[0] is when:
        return b.apply("select", when, yes.args[1], no)
    if no.op == "select" and no.args[0] is when:
        return b.apply("select", when, yes, no.args[2])
    return None


def _convert(b: Builder, type: Type, args: tuple[Value, ...]) -> Value | None:
    return args[0] if args[0].type == type else None


def _pow(b: Builder, type: Type, args: tuple[Value, ...]) -> Value | None:
    base, exponent = args
    if _is(exponent, 1.0):
        return base
    if _is(exponent, 2.0):
        return b.apply("mul", base, base)
    return None


def _comparison_rule(op: str) -> Rule:
    def rule(b: Builder, type: Type, args: tuple[Value, ...]) -> Value | None:
        if args[0] is args[1] and args[0].type not in FLOATS:
            return b.constant(_EQUAL_GIVES[op], "b1")
        if args[0].type in ("u32", "u64"):
            # No unsigned number is below zero.
            for k, always, never in ((1, "ge", "lt"), (0, "le", "gt")):
                if op in (always, never) and _is(args[k], 0):
                    return b.constant(op == always, "b1")
        return None

    return rule


_RULES: dict[str, Rule] = {
    "add": _add,
    "sub": _sub,
    "mul": _mul,
    "div": _div,
    "neg": _undo("neg"),
    "abs": _abs,
    "min": _same,
    "max": _same,
    "and": _logical(False),
    "or": _logical(True),
    "xor": _xor,
    "not": _undo("not"),
    "select": _select,
    "convert": _convert,
    "pow": _pow,
    **{op: _comparison_rule(op) for op in _EQUAL_GIVES},
}
