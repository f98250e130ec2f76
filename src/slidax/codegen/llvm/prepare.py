"""A program as the processor's own operations, in its order: sums with products fused, functions written out."""

from __future__ import annotations

from slidax.codegen.builder import Builder
from slidax.codegen.elementary import lower
from slidax.codegen.fuse import fused
from slidax.codegen.ir import ELEMENTARY, Program, Value
from slidax.codegen.rebuild import rebuild

from .order import put_in_order
from .vectorise import vectorise

ASKED = frozenset(ELEMENTARY)


def prepared(program: Program, lanes: int = 1, *, quick: bool = False) -> Program:
    """The same program, to be printed.

    - `program`: stays as it is.
    - `lanes`: as many runs are computed side by side; for a single one vectors are made of what its joints do alike.
    - `quick`: whether it may stay in the order in which it was written, which takes less time to make.
    """
    ready = lowered_and_fused(program)
    if quick:
        return ready
    if lanes == 1:
        vectorise(ready)
    put_in_order(ready)
    return ready


def lowered_and_fused(program: Program) -> Program:
    """The same program in operations that are all exactly rounded, but for functions that have no expansion.

    - `program`: stays as it is.
    """
    fuse = fused()

    def replace(builder: Builder, value: Value, args: tuple[Value, ...]) -> Value | None:
        if value.op in ASKED:
            return lower(builder, value.op, args)
        return fuse(builder, value, args)

    return rebuild(program, replace)
