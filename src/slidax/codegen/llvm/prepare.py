"""Prepare a program for printing: expand functions, fuse products and sums, vectorise, and schedule."""

from __future__ import annotations

from collections.abc import Set

from slidax.codegen.builder import Builder
from slidax.codegen.elementary import lower
from slidax.codegen.fuse import fused
from slidax.codegen.ir import ELEMENTARY, Program, Value
from slidax.codegen.rebuild import rebuild

from .order import put_in_order
from .vectorise import vectorise

FUNCTIONS = frozenset(ELEMENTARY)

CALLED = FUNCTIONS - {"exp", "erf_inv"}
"""Functions that quick code calls. The others end with a product, which may be fused with a sum around it."""


def prepared(program: Program, lanes: int = 1, *, quick: bool = False) -> Program:
    """Return a copy of a program that is ready to be printed.

    - `lanes`: number of runs that are computed in parallel. With 1, operations that are alike for all joints become
      vectors.
    - `quick`: True to keep the program's order, and to call elementary functions, which takes less time.
    """
    if quick:
        return lowered_and_fused(program, FUNCTIONS - CALLED)
    ready = lowered_and_fused(program)
    if lanes == 1:
        vectorise(ready)
    put_in_order(ready)
    return ready


def lowered_and_fused(program: Program, lowered: Set[str] = FUNCTIONS) -> Program:
    """Return a copy of a program in correctly rounded operations.

    - `lowered`: the functions that are expanded; those of constants always are.
    """
    fuse = fused()

    def replace(builder: Builder, value: Value, args: tuple[Value, ...]) -> Value | None:
        if value.op in FUNCTIONS:
            known = all(arg.op == "const" for arg in args)
            return lower(builder, value.op, args) if known or value.op in lowered else None
        return fuse(builder, value, args)

    return rebuild(program, replace)
