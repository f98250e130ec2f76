"""A program as the processor's own operations, in its order: sums with products fused, functions written out."""

from __future__ import annotations

from collections.abc import Set

from slidax.codegen.builder import Builder
from slidax.codegen.elementary import lower
from slidax.codegen.fuse import fused
from slidax.codegen.ir import ELEMENTARY, Program, Value
from slidax.codegen.rebuild import rebuild

from .order import put_in_order
from .vectorise import vectorise

ASKED = frozenset(ELEMENTARY)

CALLED = ASKED - {"exp", "erf_inv"}
"""Functions that quick code calls. The others end with a product, which a sum around it may take in."""


def prepared(program: Program, lanes: int = 1, *, quick: bool = False) -> Program:
    """The same program, to be printed.

    - `program`: stays as it is.
    - `lanes`: as many runs are computed side by side; for a single one vectors are made of what its joints do alike.
    - `quick`: whether it may stay in the order in which it was written, with elementary functions that are called,
      which takes less time to make.
    """
    if quick:
        return lowered_and_fused(program, ASKED - CALLED)
    ready = lowered_and_fused(program)
    if lanes == 1:
        vectorise(ready)
    put_in_order(ready)
    return ready


def lowered_and_fused(program: Program, lowered: Set[str] = ASKED) -> Program:
    """The same program in operations that are all exactly rounded, but for functions that have no expansion.

    - `program`: stays as it is.
    - `lowered`: the functions that are written out; of numbers that are known, all are.
    """
    fuse = fused()

    def replace(builder: Builder, value: Value, args: tuple[Value, ...]) -> Value | None:
        if value.op in ASKED:
            known = all(arg.op == "const" for arg in args)
            return lower(builder, value.op, args) if known or value.op in lowered else None
        return fuse(builder, value, args)

    return rebuild(program, replace)
