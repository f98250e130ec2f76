"""A program as an LLVM module."""

from __future__ import annotations

from slidax._errors import DefinitionError
from slidax.codegen.ir import Program

from .blocks import Blocks
from .called import Called
from .words import typed


def module(program: Program, lanes: int = 1, entry: str = "runs", *, own: bool = False) -> str:
    """The program's text in LLVM's language.

    Its one function is `void runs(ptr tables, i64 groups, i64 rows)`: `tables` holds the addresses of the inputs and
    outputs, group after group; `rows` is the number of rows of each log.

    - `program`: its functions that no processor has are called from libm, or are ours.
    - `lanes`: as many runs are computed side by side in vectors, a power of two; 1: no vectors.
    - `entry`: the name of the function.
    - `own`: whether functions that no processor has are ours, written out once and called.

    Raises DefinitionError for another number of lanes.
    """
    if lanes < 1 or lanes & (lanes - 1):
        raise DefinitionError(f"`lanes` must be a power of two, as vectors are so long; got {lanes}")
    blocks = Blocks(program, lanes, own=own)
    blocks.print()
    functions = [
        line for function in sorted(blocks.called, key=str) for line in _defined(function, blocks.declarations)
    ]
    addresses = len(program.inputs) + len(program.outputs)
    return "\n".join(
        [
            *sorted(blocks.declarations),
            *functions,
            "define internal void @group(ptr noalias readonly %table, i64 %rows) #0 {",
            "entry:",
            *blocks.lines,
            "}",
            f"define void @{entry}(ptr %tables, i64 %groups, i64 %rows) #0 {{",
            "entry:",
            "  br label %head",
            "head:",
            "  %k = phi i64 [ 0, %entry ], [ %next, %body ]",
            "  %more = icmp slt i64 %k, %groups",
            "  br i1 %more, label %body, label %after",
            "body:",
            f"  %at = mul i64 %k, {addresses}",
            "  %table = getelementptr ptr, ptr %tables, i64 %at",
            "  call void @group(ptr %table, i64 %rows)",
            "  %next = add i64 %k, 1",
            "  br label %head",
            "after:",
            "  ret void",
            "}",
            # Vectors as wide as the processor has, though some of them clock down for it.
            'attributes #0 = { nounwind noinline "prefer-vector-width"="512" "min-legal-vector-width"="512" }',
            # libm's functions as they are: not LLVM's idea of them, which would round otherwise in vectors.
            "attributes #1 = { nounwind willreturn nobuiltin memory(none) }",
            "!0 = !{}",
            "",
        ]
    )


def _defined(function: Called, declarations: set[str]) -> list[str]:
    """The lines of an elementary function; what it calls itself is added to the declarations."""
    blocks = Blocks(function.program, function.width)
    whole = typed(function.type, function.width)
    blocks.print_function(whole)
    declarations |= blocks.declarations
    given = ", ".join(f"{whole} %x{k}" for k in range(function.arguments))
    return [f"define internal {function.head}({given}) #0 {{", "entry:", *blocks.lines, "}"]
