"""Rules that translate JAX's elementwise primitives and random number generator to IR operations."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import jax
import numpy as np

from ..builder import Builder, Values
from ..ir import DTYPES, ELEMENTARY, FLOATS, Type, Value
from .arrays import Inline, constant_array, each, type_of, value_array

SAME = (
    *("add", "sub", "mul", "div", "rem", "neg", "abs", "min", "max", "sqrt", "floor", "ceil"),
    *("and", "or", "xor", "not", "eq", "ne", "lt", "le", "gt", "ge"),
)
"""Primitives with an IR operation of the same name, besides the elementary functions."""

OPERATIONS = {name: name for name in (*SAME, *ELEMENTARY)} | {
    "add_any": "add",
    "shift_left": "shl",
    "shift_right_logical": "shr",
    "shift_right_arithmetic": "sar",
    "is_finite": "isfinite",
}
"""IR operation of each primitive that has one."""

Rule = Callable[[Builder, Any, list[Values]], Values]
"""Map a builder, an equation and its input arrays to the result array."""


def apply_operation(builder: Builder, equation: Any, arrays: list[Values]) -> Values:
    """Rule of the primitives in `OPERATIONS`: return the array of the IR operation's results, element by element."""
    op = OPERATIONS[equation.primitive.name]
    apply = builder.apply
    if arrays[0].size and arrays[0].flat[0].type == "b1" and op in ("lt", "le", "gt", "ge", "max", "min", "mul", "add"):
        return each(lambda *args: _bool_operation(builder, op, args), *arrays)
    if op == "pow" and arrays[1].size and arrays[1].flat[0].type not in FLOATS:
        raise NotImplementedError("a power with an array of integers as exponent; convert the exponent to float64")
    return each(lambda *args: apply(op, *args), *arrays)


def _bool_operation(b: Builder, op: str, args: tuple[Value, ...]) -> Value:
    x, y = args
    if op in ("max", "add"):
        return b.apply("or", x, y)
    if op in ("min", "mul"):
        return b.apply("and", x, y)
    if op in ("lt", "le"):
        x, y = y, x
    return b.apply("and", x, b.apply("not", y)) if op in ("lt", "gt") else b.apply("or", x, b.apply("not", y))


def _type(equation: Any) -> Type:
    return type_of(equation.outvars[0].aval.dtype)


def _convert(b: Builder, equation: Any, arrays: list[Values]) -> Values:
    kind = _type(equation)
    if kind == "b1":
        return each(lambda x: x if x.type == "b1" else b.apply("ne", x, b.constant(0, x.type)), arrays[0])
    return each(lambda x: b.apply("convert", x, type=kind), arrays[0])


def _bitcast(b: Builder, equation: Any, arrays: list[Values]) -> Values:
    kind = _type(equation)
    if arrays[0].shape != equation.outvars[0].aval.shape:
        raise NotImplementedError("a bitcast to a type of another size; use a type with the same number of bytes")
    return each(lambda x: b.apply("bitcast", x, type=kind), arrays[0])


def _power(b: Builder, x: Value, exponent: int) -> Value:
    if exponent < 0:
        return b.apply("div", b.constant(1, x.type), _power(b, x, -exponent))
    result, square = None, x
    while exponent:
        if exponent & 1:
            result = square if result is None else b.apply("mul", result, square)
        exponent >>= 1
        if exponent:
            square = b.apply("mul", square, square)
    return b.constant(1, x.type) if result is None else result


def _sign(b: Builder, x: Value) -> Value:
    zero, plus, minus = b.constant(0, x.type), b.constant(1, x.type), b.constant(-1, x.type)
    if x.type in ("u32", "u64"):
        return b.apply("select", b.apply("gt", x, zero), plus, zero)
    # Zeros keep their sign, and NaN is NaN.
    rest = b.apply("select", b.apply("lt", x, zero), minus, x if x.type in FLOATS else zero)
    return b.apply("select", b.apply("gt", x, zero), plus, rest)


def _round(b: Builder, equation: Any, x: Value) -> Value:
    if int(equation.params["rounding_method"]) == 1:
        return b.apply("rint", x)
    whole = b.apply("floor", b.apply("abs", x))
    is_half = b.apply("ge", b.apply("sub", b.apply("abs", x), whole), b.constant(0.5, x.type))
    size = b.apply("add", whole, b.apply("select", is_half, b.constant(1.0, x.type), b.constant(0.0, x.type)))
    return b.apply("select", b.apply("lt", x, b.constant(0.0, x.type)), b.apply("neg", size), size)


def _select(b: Builder, equation: Any, arrays: list[Values]) -> Values:
    which, *cases = arrays
    if which.size and which.flat[0].type != "b1" and len(cases) > 2:
        raise NotImplementedError("a choice between more than two arrays; use `jnp.where` several times")

    def choice(when: Value, no: Value, yes: Value | None = None) -> Value:
        if yes is None:
            return no
        if when.type != "b1":
            when = b.apply("ne", when, b.constant(0, when.type))
        return b.apply("select", when, yes, no)

    return each(choice, which, *cases)


def _logistic(b: Builder, x: Value) -> Value:
    unit = b.constant(1.0, x.type)
    return b.apply("div", unit, b.apply("add", unit, b.apply("exp", b.apply("neg", x))))


def _total_order_comparison(op: str) -> Rule:
    """Return the rule of a comparison in which NaN is larger than every number, and zeros of both signs are equal.

    - `op`: "lt" or "le".
    """

    def rule(b: Builder, equation: Any, arrays: list[Values]) -> Values:
        def compare(x: Value, y: Value) -> Value:
            below_nan = b.apply("ne", y, y) if op == "le" else b.apply("and", b.apply("eq", x, x), b.apply("ne", y, y))
            return b.apply("or", b.apply(op, x, y), below_nan)

        return each(compare, *arrays)

    return rule


def _one_minus_square(b: Builder, x: Value) -> Value:
    """`(1 + x)(1 - x)`, the derivative of tanh where tanh has the value x; accurate near x = ±1."""
    unit = b.constant(1.0, x.type)
    return b.apply("mul", b.apply("add", unit, x), b.apply("sub", unit, x))


ELEMENTWISE_RULES: dict[str, Rule] = {
    **dict.fromkeys(OPERATIONS, apply_operation),
    "convert_element_type": _convert,
    "bitcast_convert_type": _bitcast,
    "integer_pow": lambda b, eqn, arrays: each(lambda x: _power(b, x, eqn.params["y"]), arrays[0]),
    "square": lambda b, eqn, arrays: each(lambda x: b.apply("mul", x, x), arrays[0]),
    "one_minus_square": lambda b, eqn, arrays: each(lambda x: _one_minus_square(b, x), arrays[0]),
    "rsqrt": lambda b, eqn, arrays: each(
        lambda x: b.apply("div", b.constant(1.0, x.type), b.apply("sqrt", x)), arrays[0]
    ),
    "exp2": lambda b, eqn, arrays: each(lambda x: b.apply("pow", b.constant(2.0, x.type), x), arrays[0]),
    "logistic": lambda b, eqn, arrays: each(lambda x: _logistic(b, x), arrays[0]),
    "sign": lambda b, eqn, arrays: each(lambda x: _sign(b, x), arrays[0]),
    "round": lambda b, eqn, arrays: each(lambda x: _round(b, eqn, x), arrays[0]),
    "select_n": _select,
    "lt_to": _total_order_comparison("lt"),
    "le_to": _total_order_comparison("le"),
    "clamp": lambda b, eqn, arrays: each(lambda low, x, high: b.apply("min", b.apply("max", x, low), high), *arrays),
    "copy": lambda b, eqn, arrays: arrays[0],
    "copy_p": lambda b, eqn, arrays: arrays[0],
    "stop_gradient": lambda b, eqn, arrays: arrays[0],
}
"""Rule of each primitive, by its name."""


PARITY = 0x1BD11BDA
ROTATIONS = ((13, 15, 26, 6), (17, 29, 16, 24))


def threefry(b: Builder, equation: Any, arrays: list[Values]) -> list[Values]:
    """Rule of JAX's generator threefry2x32: return two arrays of random 32-bit words, uniformly distributed.

    - `arrays`: four arrays: first words of the keys, second words of the keys, and likewise for the counters.
    """
    arrays = list(np.broadcast_arrays(*arrays))
    pairs = [_threefry(b, *row) for row in zip(*(array.ravel() for array in arrays), strict=True)]
    shape = arrays[0].shape
    return [value_array([pair[k] for pair in pairs], shape) for k in (0, 1)]


def _threefry(b: Builder, key0: Value, key1: Value, x0: Value, x1: Value) -> tuple[Value, Value]:
    apply = b.apply
    parity = b.constant(PARITY, "u32")
    keys = (key0, key1, apply("xor", apply("xor", key0, key1), parity))
    x0, x1 = apply("add", x0, keys[0]), apply("add", x1, keys[1])
    for block in range(5):
        for distance in ROTATIONS[block % 2]:
            x0 = apply("add", x0, x1)
            left = apply("shl", x1, b.constant(distance, "u32"))
            right = apply("shr", x1, b.constant(32 - distance, "u32"))
            x1 = apply("xor", apply("or", left, right), x0)
        x0 = apply("add", x0, keys[(block + 1) % 3])
        x1 = apply("add", apply("add", x1, keys[(block + 2) % 3]), b.constant(block + 1, "u32"))
    return x0, x1


def counters(b: Builder, equation: Any, arrays: list[Values]) -> list[Values]:
    """Rule of the counters from which random numbers are made, 0, 1, 2, ...: return their high and low 32-bit words."""
    shape = equation.params["shape"]
    low = np.arange(int(np.prod(shape, dtype=int)), dtype=np.uint32).reshape(shape)
    return [constant_array(b, np.zeros_like(low)), constant_array(b, low)]


def inline_generator(name: str) -> Callable[[Builder, Any, list[Values], Inline], list[Values]]:
    """Return the rule of a primitive on random keys; the rule traces a function of JAX's generator into the program.

    - `name`: name of this function: "seed", "fold_in", "random_bits" or "split".
    """

    def rule(b: Builder, equation: Any, arrays: list[Values], inline: Inline) -> list[Values]:
        impl = equation.params.get("impl") or equation.invars[0].aval.dtype._impl
        if impl.name != "threefry2x32":
            raise NotImplementedError(f"the generator `{impl.name}`; use JAX's default, threefry2x32")
        if equation.invars[0].aval.ndim:
            raise NotImplementedError("an array of random keys; use a single key")
        function = getattr(impl, name)
        more: tuple[Any, ...] = ()
        if name == "random_bits":
            more = (equation.params["bit_width"], equation.params["shape"])
        elif name == "split":
            more = (equation.params["shape"],)
        shapes = [jax.ShapeDtypeStruct(array.shape, DTYPES[array.flat[0].type]) for array in arrays]
        jaxpr = jax.make_jaxpr(lambda *args: function(*args, *more))(*shapes)
        return inline(jaxpr, arrays)

    return rule


def key_words(b: Builder, equation: Any, arrays: list[Values]) -> Values:
    """Rule of conversions between a random key and its words. The IR stores both equally: return the input."""
    return each(lambda x: x, arrays[0])
