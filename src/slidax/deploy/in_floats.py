"""Constants of a program for doubles, adapted to floats."""

from __future__ import annotations

import numpy as np

from slidax.codegen.builder import Builder
from slidax.codegen.ir import Program, Value
from slidax.codegen.rebuild import rebuild

DOUBLE, FLOAT = float(np.finfo(np.float64).eps), float(np.finfo(np.float32).eps)
TOLERANCES = (0.1 * DOUBLE, 1e-10)
"""A constant in this range is a tolerance: no robot gain is that small, and guards against division by zero are far
smaller.
"""

ULPS = 16.0
"""Largest tolerance in units in the last place, which a search meets easily."""

FEWEST = 4.0
"""Smallest tolerance in units in the last place; below it, rounding of a sum of some terms cannot meet it."""

NEXT_TO_ONE = 4.0 * FLOAT


def in_floats(program: Program) -> Program:
    """Return the program with constants that mean in floats what they mean in doubles.

    Tolerances become as many units in the last place, at least 4 and at most 16, so that a search that is to meet them
    ends. A number next to one, which keeps a logarithm finite, stays next to one.
    """

    def replaced(builder: Builder, value: Value, args: tuple[Value, ...]) -> Value | None:
        fitted = tuple(
            builder.constant(fitting(arg.data), "f64") if arg.op == "const" and arg.type == "f64" else arg
            for arg in args
        )
        if all(new is old for new, old in zip(fitted, args, strict=True)):
            return None
        return builder.apply(value.op, *fitted, type=value.type, data=value.data)

    return rebuild(program, replaced)


def fits(program: Program) -> bool:
    """True if all constants of a program for doubles mean the same in floats."""
    return all(
        fitting(value.data) == value.data for value in program.walk() if value.op == "const" and value.type == "f64"
    )


def fitting(number: float) -> float:
    """Return a constant for floats from one for doubles."""
    size = abs(number)
    if TOLERANCES[0] < size < TOLERANCES[1]:
        return float(np.copysign(min(max(size / DOUBLE, FEWEST), ULPS) * FLOAT, number))
    if 0.0 < abs(size - 1.0) < NEXT_TO_ONE:
        return float(np.copysign(1.0 + np.copysign(NEXT_TO_ONE, size - 1.0), number))
    return number
