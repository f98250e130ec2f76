"""A program as the processor's own operations: products fused into sums, elementary functions written out."""

from __future__ import annotations

from slidax.codegen.builder import Builder
from slidax.codegen.elementary import written_out
from slidax.codegen.form import ELEMENTARY, Program, Value
from slidax.codegen.fuse import fused
from slidax.codegen.rebuild import rebuild

ASKED = frozenset(ELEMENTARY)


def prepared(program: Program) -> Program:
    """The same program, to be printed.

    - `program`: stays as it is.
    """
    fuse = fused()

    def replace(builder: Builder, value: Value, args: tuple[Value, ...]) -> Value | None:
        if value.op in ASKED:
            return written_out(builder, value.op, args)
        return fuse(builder, value, args)

    return rebuild(program, replace)
