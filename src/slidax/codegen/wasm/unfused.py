"""A program for a processor without multiply-adds, which WebAssembly is.

Products with a known zero are zero, as an arm's frames have many: only a number that is not finite would say otherwise.
Sums with products in them are rounded twice there, where native code rounds them once. In elementary functions some
multiply-adds say what a rounding left out, so that they are worth nothing rounded twice: these are written out.
"""

from __future__ import annotations

import numpy as np

from slidax.codegen.builder import Builder
from slidax.codegen.elementary import lower
from slidax.codegen.elementary.expression import Expression, select
from slidax.codegen.ir import Program, Value
from slidax.codegen.rebuild import rebuild

HALVES = 2.0**27 + 1.0
"""Times a number, it parts its 53 bits into two halves (Veltkamp)."""

INLINE = frozenset({"erf", "erf_inv"})
"""Functions that are written out where they are used; the others are functions of the module."""


def unfused(program: Program) -> Program:
    """The same program without multiply-adds, and with the rare functions written out.

    - `program`: stays as it is.
    """
    return rebuild(rebuild(program, _written_out), _without_fma)


def function(name: str) -> Program:
    """An elementary function by itself, from `x0` and perhaps `x1`.

    - `name`: of the operation.
    """
    builder = Builder()
    args = [builder.input(f"x{k}", "f64", ()).item() for k in range(2 if name in ("pow", "atan2") else 1)]
    builder.output("y", "f64", np.array(builder.apply(name, *args), object))
    return rebuild(rebuild(builder.finish(), lambda b, value, args: lower(b, value.op, args)), _without_fma)


def _written_out(builder: Builder, value: Value, args: tuple[Value, ...]) -> Value | None:
    return lower(builder, value.op, args) if value.op in INLINE else None


def _without_fma(builder: Builder, value: Value, args: tuple[Value, ...]) -> Value | None:
    if value.op == "mul" and value.type == "f64" and any(arg.op == "const" and arg.data == 0.0 for arg in args):
        return builder.constant(0.0, "f64")
    if value.op != "fma":
        return None
    a, b, c = (Expression(builder, arg) for arg in args)
    # What is added to a constant, or to another such sum, is a term of a series: a rounding more is harmless.
    if value.args[2].op in ("const", "fma"):
        return (a * b + c).value
    return _rounded_once(a, b, c).value


def _rounded_once(a: Expression, b: Expression, c: Expression) -> Expression:
    """`a b + c` to about 2^-53 of its own size, by the exact product and the exact sum (Dekker, Knuth)."""
    product = a * b
    a_high, a_low = _halves(a)
    b_high, b_low = _halves(b)
    rest = a_low * b_low - (((product - a_high * b_high) - a_low * b_high) - a_high * b_low)
    total = product + c
    of_c = total - product
    left = (product - (total - of_c)) + (c - of_c)
    exact = total + (left + rest)
    # Of what is infinite, or so large that its halves are, there are no rests.
    return select(exact.equals(exact), exact, total)


def _halves(x: Expression) -> tuple[Expression, Expression]:
    scaled = x * HALVES
    high = scaled - (scaled - x)
    return high, x - high
