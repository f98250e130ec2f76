"""Compile a program to a WebAssembly module."""

from __future__ import annotations

import functools
import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from slidax._errors import DefinitionError
from slidax.codegen.digest import digest
from slidax.codegen.ir import ELEMENTARY, Program, Type
from slidax.codegen.llvm import available, cache
from slidax.codegen.llvm.order import put_in_order
from slidax.codegen.no_native_code import in_one_line

from .body import FUSED, Body, helpers
from .fused import function, with_known
from .instructions import MADD, madds
from .object_file import bodies, functions_of, with_export

TRIPLE = "wasm32-unknown-unknown"
FEATURES = "+nontrapping-fptoint,+sign-ext,+bulk-memory,+simd128,+relaxed-simd"
OPTIMISED = 2
"""LLVM's optimisation level for instruction selection, scheduling and locals."""

ENTRY, TWICE, ONCE = "run", "twice_rounded", "once_rounded"
"""The exported function, and the replacements of multiply-adds for a browser without them."""


@dataclass(frozen=True)
class Module:
    """A WebAssembly module, and the layout of its arguments.

    Its only import is the memory, `env.__linear_memory`. The exported function is `run(table, rows)`: `table` is the
    address of the 32-bit addresses of all inputs and then all outputs, and `rows` is the number of rows of each logged
    output. Booleans are stored as bytes, all other types as in C.

    A browser may lack the multiply-add instruction. Each one is then replaced by a call with the same number of bytes:
    in elementary functions, which need it, to a function that rounds once, and elsewhere to one that rounds twice.

    - `inputs`: type and number of elements.
    - `outputs`: type, number of elements (of a row, if logged), and True for a logged output.
    - `digest`: equal for equal programs.
    - `code`: offsets of the code's beginning and end.
    - `entry_at`: offset from which on multiply-adds may be rounded twice.
    - `once`, `twice`: indices of both replacement functions.
    - `others`: offsets at which the bytes of a multiply-add mean something else.
    """

    bytes: bytes
    inputs: tuple[tuple[Type, int], ...]
    outputs: tuple[tuple[Type, int, bool], ...]
    digest: str
    code: tuple[int, int]
    entry_at: int
    once: int
    twice: int
    others: tuple[int, ...]


def wasm_module(program: Program, known: Mapping[int, np.ndarray] | None = None) -> Module:
    """Compile a program, which is not changed.

    - `known`: inputs that become constants of the module, by position; the module does not have them as inputs.

    Raises DefinitionError if llvmlite is missing, or an operation of the program has no code.
    """
    known = known or {}
    with in_one_line(lambda: "the program"):
        version, compile = _compiler()
        identity = hashlib.sha256(digest(program).encode())
        for position, array in sorted(known.items()):
            identity.update(f"{position} {array.dtype} {array.shape}".encode() + array.tobytes())
        key = "\n".join([version, TRIPLE, FEATURES, str(OPTIMISED), identity.hexdigest()])
        object = cache.load_code(key)
        if object is None:
            object = compile(_text(with_known(program, known)))
            cache.store_code(key, object)
    module, indices = with_export(object, ENTRY), functions_of(object)
    functions = list(bodies(module))
    instructions = {start + at for start, body in functions for at in madds(body)}
    patterns = {at for at in range(functions[0][0], len(module)) if module[at : at + len(MADD)] == MADD}
    return Module(
        bytes=module,
        inputs=tuple((entry.type, entry.size) for k, entry in enumerate(program.inputs) if k not in known),
        outputs=tuple((entry.type, entry.size, entry.values is None) for entry in program.outputs),
        digest=identity.hexdigest(),
        code=(functions[0][0], functions[-1][0] + len(functions[-1][1])),
        entry_at=functions[indices[ENTRY]][0],
        once=indices[ONCE],
        twice=indices[TWICE],
        others=tuple(sorted(patterns - instructions)),
    )


def _text(ready: Program) -> str:
    put_in_order(ready)
    body = Body(ready, 1)
    body.print()
    called = sorted({value.op for value in ready.walk() if value.op in ELEMENTARY})
    functions = [_function(name) for name in called]
    declared = {line for line in body.declarations if line.rpartition("#")[2] != "1"}
    return "\n".join(
        [
            f'target datalayout = "{_machine().target_data}"',
            f'target triple = "{TRIPLE}"',
            *sorted(declared.union({FUSED}, *(declarations for _, declarations in functions))),
            *helpers(ONCE, TWICE),
            *(line for lines, _ in functions for line in lines),
            f"define void @{ENTRY}(ptr noalias readonly %table, i32 %count) #0 {{",
            "entry:",
            "%rows = zext i32 %count to i64",
            *body.lines,
            "}",
            "attributes #0 = { nounwind noinline }",
            "!0 = !{}",
            "",
        ]
    )


def _function(name: str) -> tuple[list[str], set[str]]:
    """LLVM IR of an elementary function, and its declarations."""
    program = function(name)
    put_in_order(program)
    body = Body(program, 1)
    body.print_function("double")
    arguments = ", ".join(f"double %x{k}" for k in range(len(program.inputs)))
    head = f"define internal double @{name}({arguments}) #0 {{"
    return [head, "entry:", *body.lines, "}"], body.declarations


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
    """The compiler's version, and a function from LLVM IR to an object file."""
    machine = _machine()
    import llvmlite
    import llvmlite.binding as llvm

    def compile(text: str) -> bytes:
        return bytes(machine.emit_object(llvm.parse_assembly(text)))

    return f"llvmlite {llvmlite.__version__}, LLVM {llvm.llvm_version_info}", compile
