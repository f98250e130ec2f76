"""A program as a WebAssembly module."""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import Any

from slidax._errors import DefinitionError
from slidax.codegen.digest import digest
from slidax.codegen.ir import ELEMENTARY, Program, Type, Value
from slidax.codegen.llvm import available, cache
from slidax.codegen.llvm.blocks import Blocks
from slidax.codegen.llvm.order import put_in_order
from slidax.codegen.llvm.vectorise import vectorise
from slidax.codegen.no_native_code import in_one_line

from .object_file import with_export
from .unfused import function, unfused

TRIPLE = "wasm32-unknown-unknown"
FEATURES = "+nontrapping-fptoint,+sign-ext,+bulk-memory,+simd128"
OPTIMISED = 2
"""LLVM's level for instruction selection, scheduling and locals."""

COLUMNS = ("f64", "f32", "i64", "i32", "u64", "u32", "b1")


@dataclass(frozen=True)
class Module:
    """A module, and what its one function takes.

    Its memory is imported as `env.__linear_memory`, and nothing else is. The function `run(table, rows)` is given the
    address of a table with the addresses, 32 bits each, of all inputs and then of all outputs, and how many rows each
    logged output has room for. Truth values lie in memory as bytes, all else as in C.

    - `bytes`: the module.
    - `inputs`: type, and number of elements of each.
    - `outputs`: type, number of elements of each or of one of its rows, and whether it has rows.
    - `digest`: equal for equal programs.
    """

    bytes: bytes
    inputs: tuple[tuple[Type, int], ...]
    outputs: tuple[tuple[Type, int, bool], ...]
    digest: str


def wasm_module(program: Program, *, vectors: bool = False) -> Module:
    """The module of a program.

    - `program`: stays as it is.
    - `vectors`: whether what is done alike is put side by side in vectors of 128 bits.

    Raises DefinitionError if llvmlite is missing, or the program asks for what there is no code for.
    """
    with in_one_line(lambda: "the program"):
        what = digest(program)
        version, compiled = _compiler()
        key = "\n".join([version, TRIPLE, FEATURES, str(OPTIMISED), str(vectors), what])
        made = cache.kept(key)
        if made is None:
            made = with_export(compiled(_text(program, vectors)), "run")
            cache.keep(key, made)
    inputs = tuple((entry.type, entry.size) for entry in program.inputs)
    outputs = tuple((entry.type, entry.size, entry.values is None) for entry in program.outputs)
    return Module(made, inputs, outputs, what)


def _text(program: Program, vectors: bool) -> str:
    ready = unfused(program)
    if vectors:
        vectorise(ready)
    put_in_order(ready)
    blocks = Blocks(ready, 1)
    blocks.print()
    called = sorted({value.op for value in ready.walk() if value.op in ELEMENTARY})
    functions = [_function(name) for name in called]
    declared = {line for line in blocks.declarations if line.rpartition("#")[2] != "1"}
    return "\n".join(
        [
            f'target datalayout = "{_layout()}"',
            f'target triple = "{TRIPLE}"',
            *sorted(declared.union(*(declarations for _, declarations in functions))),
            *(line for lines, _ in functions for line in lines),
            "define void @run(ptr noalias readonly %table, i32 %count) #0 {",
            "entry:",
            "%rows = zext i32 %count to i64",
            *blocks.lines,
            "}",
            "attributes #0 = { nounwind noinline }",
            "!0 = !{}",
            "",
        ]
    )


def _function(name: str) -> tuple[list[str], set[str]]:
    """The lines of an elementary function, and what they declare."""
    program = function(name)
    put_in_order(program)
    blocks = Body(program, 1)
    result = blocks.print_function()
    arguments = ", ".join(f"double %x{k}" for k in range(len(program.inputs)))
    head = f"define internal double @{name}({arguments}) #0 {{"
    return [head, "entry:", *blocks.lines, f"ret double {result}", "}"], blocks.declarations


class Body(Blocks):
    """The lines of a function of numbers."""

    def print_function(self) -> str:
        """Writes them; returns the word of its one result."""
        self._region(self.program.body)
        (output,) = self.program.outputs
        assert output.values is not None
        return self._word(output.values[0], 1)

    def _read(self, value: Value) -> None:
        self._names[value] = f"%x{value.data[0]}"


def _layout() -> str:
    return str(_machine().target_data)


@functools.cache
def _machine() -> Any:
    if not available():
        raise DefinitionError('WebAssembly needs llvmlite, which is not installed: pip install "slidax[native]"')
    import llvmlite.binding as llvm

    llvm.initialize_all_targets()
    llvm.initialize_all_asmprinters()
    return llvm.Target.from_triple(TRIPLE).create_target_machine(
        cpu="generic", features=FEATURES, opt=OPTIMISED, reloc="static", codemodel="default"
    )


def _compiler() -> tuple[str, Any]:
    """What it is, and from LLVM's text to an object file."""
    machine = _machine()
    import llvmlite
    import llvmlite.binding as llvm

    def compiled(text: str) -> bytes:
        return bytes(machine.emit_object(llvm.parse_assembly(text)))

    return f"llvmlite {llvmlite.__version__}, LLVM {llvm.llvm_version_info}", compiled
