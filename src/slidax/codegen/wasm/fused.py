"""Fuse a program as for native code, then replace inputs by constants."""

from __future__ import annotations

from collections.abc import Mapping
from fractions import Fraction
from typing import Any

import numpy as np

from slidax.codegen.builder import Builder
from slidax.codegen.elementary import lower
from slidax.codegen.fuse import fused
from slidax.codegen.ir import Program, Value
from slidax.codegen.rebuild import Rebuilding, rebuild
from slidax.codegen.trace.arrays import of_numbers

INLINE = frozenset({"erf", "erf_inv"})
"""Elementary functions that are expanded where they are used; the others are functions of the module."""


def with_known(program: Program, known: Mapping[int, np.ndarray]) -> Program:
    """Return a copy of a program, fused as native code is, with some inputs replaced by constants.

    Products with a constant zero are dropped, because an arm's frames have many of them. The results then differ from
    native code only for factors that are not finite, as products and sums are fused before the replacement.

    - `known`: constants by the input's position.
    """
    fuse = fused()
    ready = rebuild(program, lambda builder, value, args: None if value.origin else fuse(builder, value, args))
    return _Substitution(ready, known).finish()


def function(name: str) -> Program:
    """Return the program of one elementary function, with the inputs `x0` and, for two arguments, `x1`."""
    builder = Builder()
    args = [builder.input(f"x{k}", "f64", ()).item() for k in range(2 if name in ("pow", "atan2") else 1)]
    builder.output("y", "f64", np.array(builder.apply(name, *args), object))
    return rebuild(builder.finish(), lambda b, value, args: lower(b, value.op, args))


class _Substitution(Rebuilding):
    """Replaces inputs by constants."""

    def __init__(self, program: Program, known: Mapping[int, np.ndarray]) -> None:
        super().__init__(program, _simpler, {})
        self.builder.program.inputs.clear()
        self.inputs = [
            of_numbers(self.builder, known[k]).ravel()
            if k in known
            else self.builder.input(entry.name, entry.type, entry.shape, varying=entry.varying).ravel()
            for k, entry in enumerate(program.inputs)
        ]


def _simpler(builder: Builder, value: Value, args: tuple[Value, ...]) -> Value | None:
    op = value.op
    if op == "copy":
        return args[0]
    if op in INLINE:
        return lower(builder, op, args)
    if value.type != "f64":
        return None
    if op == "mul" and any(_is(arg, 0.0) for arg in args):
        return builder.constant(0.0, "f64")
    if op != "fma":
        return None
    a, b, c = args
    if _is(a, 0.0) or _is(b, 0.0):
        return c
    for factor, other in ((a, b), (b, a)):
        if _is(factor, 1.0):
            return builder.apply("add", other, c)
        if _is(factor, -1.0):
            return builder.apply("sub", c, other)
    if _is(c, 0.0):
        return builder.apply("mul", a, b)
    if all(arg.op == "const" and np.isfinite(arg.data) for arg in args):
        x, y, z = (Fraction(arg.data) for arg in args)
        return builder.constant(float(x * y + z), "f64")
    return None


def _is(value: Value, number: float) -> bool:
    known: Any = value.data
    return value.op == "const" and bool(known == number)
