"""Generate an LLVM module from a program."""

from __future__ import annotations

from slidax._errors import DefinitionError
from slidax.codegen.ir import Program

from .blocks import Blocks
from .called import ElementaryFunction
from .words import typed


def module(program: Program, lanes: int = 1, entry: str = "runs", *, own: bool = False) -> str:
    """Generate the LLVM IR of a program.

    Its function is `void runs(ptr tables, i64 groups, i64 rows)`: `tables` contains the addresses of the inputs and
    outputs, group after group; `rows` is the number of rows of each log.

    - `lanes`: number of runs that are computed in parallel, a power of two.
    - `entry`: name of the function.
    - `own`: True if elementary functions are defined in the module; False for libm's.

    Raises DefinitionError for another number of lanes.
    """
    if lanes < 1 or lanes & (lanes - 1):
        raise DefinitionError(f"`lanes` must be a power of two; got {lanes}")
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
            # The processor's widest vectors, although some processors reduce their clock rate for them.
            'attributes #0 = { nounwind noinline "prefer-vector-width"="512" "min-legal-vector-width"="512" }',
            # libm's functions, not LLVM's builtins, which round differently in vectors.
            "attributes #1 = { nounwind willreturn nobuiltin memory(none) }",
            "!0 = !{}",
            "",
        ]
    )


def _defined(function: ElementaryFunction, declarations: set[str]) -> list[str]:
    """LLVM IR of an elementary function; the functions that it calls are added to the declarations."""
    blocks = Blocks(function.program, function.width)
    whole = typed(function.type, function.width)
    blocks.print_function(whole)
    declarations |= blocks.declarations
    arguments = ", ".join(f"{whole} %x{k}" for k in range(function.arguments))
    return [f"define internal {function.head}({arguments}) #0 {{", "entry:", *blocks.lines, "}"]
