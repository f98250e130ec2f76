"""A program as a WebAssembly module."""

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
"""LLVM's level for instruction selection, scheduling and locals."""

ENTRY, TWICE, ONCE = "run", "twice_rounded", "once_rounded"
"""The function that is called, and those that stand for multiply-adds in a browser that has none."""


@dataclass(frozen=True)
class Module:
    """A module, and what its one function takes.

    Its memory is imported as `env.__linear_memory`, and nothing else is. The function `run(table, rows)` is given the
    address of a table with the addresses, 32 bits each, of all inputs and then of all outputs, and how many rows each
    logged output has room for. Truth values lie in memory as bytes, all else as in C.

    Its multiply-adds are instructions that a browser may not know. Then each is replaced by a call, of as many bytes:
    of a function that rounds once in elementary functions, which need it, and of one that rounds twice elsewhere.

    - `bytes`: the module.
    - `inputs`: type, and number of elements of each.
    - `outputs`: type, number of elements of each or of one of its rows, and whether it has rows.
    - `digest`: equal for equal programs.
    - `code`: where the code begins that may be changed so, and where it ends.
    - `entry_at`: from where on multiply-adds may be rounded twice.
    - `once`, `twice`: the numbers of both functions.
    - `others`: where the bytes of a multiply-add stand and mean something else.
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
    """The module of a program.

    - `program`: stays as it is.
    - `known`: inputs that are numbers of the module, by their places; the module does not have them.

    Raises DefinitionError if llvmlite is missing, or the program asks for what there is no code for.
    """
    known = known or {}
    with in_one_line(lambda: "the program"):
        version, compiled = _compiler()
        what = hashlib.sha256(digest(program).encode())
        for place, array in sorted(known.items()):
            what.update(f"{place} {array.dtype} {array.shape}".encode() + array.tobytes())
        key = "\n".join([version, TRIPLE, FEATURES, str(OPTIMISED), what.hexdigest()])
        object = cache.kept(key)
        if object is None:
            object = compiled(_text(with_known(program, known)))
            cache.keep(key, object)
    made, names = with_export(object, ENTRY), functions_of(object)
    places = list(bodies(made))
    found = {start + at for start, body in places for at in madds(body)}
    seen = {at for at in range(places[0][0], len(made)) if made[at : at + len(MADD)] == MADD}
    return Module(
        bytes=made,
        inputs=tuple((entry.type, entry.size) for k, entry in enumerate(program.inputs) if k not in known),
        outputs=tuple((entry.type, entry.size, entry.values is None) for entry in program.outputs),
        digest=what.hexdigest(),
        code=(places[0][0], places[-1][0] + len(places[-1][1])),
        entry_at=places[names[ENTRY]][0],
        once=names[ONCE],
        twice=names[TWICE],
        others=tuple(sorted(seen - found)),
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
    """The lines of an elementary function, and what they declare."""
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
    """What it is, and from LLVM's text to an object file."""
    machine = _machine()
    import llvmlite
    import llvmlite.binding as llvm

    def compiled(text: str) -> bytes:
        return bytes(machine.emit_object(llvm.parse_assembly(text)))

    return f"llvmlite {llvmlite.__version__}, LLVM {llvm.llvm_version_info}", compiled
