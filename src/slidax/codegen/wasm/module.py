"""Compile a program to a WebAssembly module with LLVM."""

from __future__ import annotations

import functools
import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np

from slidax.core.errors import DefinitionError

from ..builder import Builder
from ..elementary.lowering import lower
from ..ir import ELEMENTARY, Program, Type, Value, as_native_code_error, digest
from ..llvm import machine as cache
from ..llvm.blocks import Blocks
from ..llvm.machine import available
from ..llvm.order import put_in_order
from ..passes import Rebuilding, fuse_products, rebuild
from ..trace.arrays import constant_array
from .binary import MADD, bodies, find_multiply_adds, functions_of, with_export

PAIR = "<2 x double>"
FUSED = f"declare {PAIR} @llvm.wasm.relaxed.madd.v2f64({PAIR}, {PAIR}, {PAIR})"


class Body(Blocks):
    """Writer of a function body in LLVM IR for WebAssembly: calls elementary functions, uses relaxed multiply-adds."""

    def _value(self, value: Value) -> None:
        name, pairs = f"%v{value.number}", []
        if value.op in ELEMENTARY:
            arguments = ", ".join(f"double {self._word(arg, 1)}" for arg in value.args)
            self.write(f"{name} = call double @{value.op}({arguments})")
            return
        if value.op != "fma":
            super()._value(value)
            return
        for k, arg in enumerate(value.args):
            # The number fills both lanes, which costs less than a zero in the second lane.
            self.write(f"{name}h{k} = insertelement {PAIR} poison, double {self._word(arg, 1)}, i32 0")
            self.write(f"{name}w{k} = shufflevector {PAIR} {name}h{k}, {PAIR} poison, <2 x i32> zeroinitializer")
            pairs.append(f"{PAIR} {name}w{k}")
        self.write(f"{name}p = call {PAIR} @llvm.wasm.relaxed.madd.v2f64({', '.join(pairs)})")
        self.write(f"{name} = extractelement {PAIR} {name}p, i32 0")


def helpers(once: str, twice: str) -> list[str]:
    """Return the LLVM IR lines of two functions for `a b + c`, for browsers without the multiply-add instruction.

    - `once`: name of the function that rounds once, from the exact product and sum (Dekker, Knuth); its result may
      differ from the correctly rounded one in the last bit.
    - `twice`: name of the function that rounds product and sum.
    """
    halves = f"splat (double {2.0**27 + 1.0})"
    steps = [
        ("product", "fmul", "%a", "%b"),
        *_halves("a", halves),
        *_halves("b", halves),
        ("hh", "fmul", "%ah", "%bh"),
        ("left1", "fsub", "%product", "%hh"),
        ("lh", "fmul", "%al", "%bh"),
        ("left2", "fsub", "%left1", "%lh"),
        ("hl", "fmul", "%ah", "%bl"),
        ("left3", "fsub", "%left2", "%hl"),
        ("ll", "fmul", "%al", "%bl"),
        ("rest", "fsub", "%ll", "%left3"),
        ("total", "fadd", "%product", "%c"),
        ("ofc", "fsub", "%total", "%product"),
        ("ofp", "fsub", "%total", "%ofc"),
        ("missp", "fsub", "%product", "%ofp"),
        ("missc", "fsub", "%c", "%ofc"),
        ("miss", "fadd", "%missp", "%missc"),
        ("more", "fadd", "%miss", "%rest"),
        ("exact", "fadd", "%total", "%more"),
    ]
    arguments = f"({PAIR} %a, {PAIR} %b, {PAIR} %c)"
    return [
        f"define {PAIR} @{once}{arguments} #0 {{",
        "entry:",
        *(f"%{name} = {op} {PAIR} {x}, {y}" for name, op, x, y in steps),
        # NaN if a number or its halves overflow; then the rounded sum is the result.
        f"%known = fcmp oeq {PAIR} %exact, %exact",
        f"%result = select <2 x i1> %known, {PAIR} %exact, {PAIR} %total",
        f"ret {PAIR} %result",
        "}",
        f"define {PAIR} @{twice}{arguments} #0 {{",
        "entry:",
        f"%product = fmul {PAIR} %a, %b",
        f"%sum = fadd {PAIR} %product, %c",
        f"ret {PAIR} %sum",
        "}",
    ]


def _halves(name: str, scale: str) -> list[tuple[str, str, str, str]]:
    """Split a number into two halves of its bits (Veltkamp)."""
    return [
        (f"{name}s", "fmul", f"%{name}", scale),
        (f"{name}d", "fsub", f"%{name}s", f"%{name}"),
        (f"{name}h", "fsub", f"%{name}s", f"%{name}d"),
        (f"{name}l", "fsub", f"%{name}", f"%{name}h"),
    ]


INLINE = frozenset({"erf", "erf_inv"})
"""Elementary functions that are inlined; the others are functions of the module."""


def substitute_inputs(program: Program, known: Mapping[int, np.ndarray]) -> Program:
    """Return a copy of a program with multiply-adds as in native code, and some inputs replaced by constants.

    Products and sums are fused before the replacement, so that results equal those of native code. Values with an
    `origin` are not fused: in the program of a closed loop, these are computed before the first sample, for which a
    native run uses JAX. Products with a constant zero, of which an arm's frames have many, are then dropped: results
    differ if the other factor is not finite.

    - `known`: numbers of the replaced inputs, by the input's position among the program's inputs.
    """
    ready = rebuild(program, lambda builder, value, args: None if value.origin else fuse_products(builder, value, args))
    return _Substitution(ready, known).finish()


def elementary_program(name: str) -> Program:
    """Return a program of basic operations for an elementary function; its inputs are `x0` and, if it has two, `x1`."""
    builder = Builder()
    args = [builder.input(f"x{k}", "f64", ()).item() for k in range(2 if name in ("pow", "atan2") else 1)]
    builder.output("y", "f64", np.array(builder.apply(name, *args), object))
    return rebuild(builder.finish(), lambda b, value, args: lower(b, value.op, args))


class _Substitution(Rebuilding):
    """Replaces inputs by constants."""

    def __init__(self, program: Program, known: Mapping[int, np.ndarray]) -> None:
        super().__init__(program, _simpler, {})
        self.builder.program.inputs.clear()
        self.inputs = [
            constant_array(self.builder, known[k]).ravel()
            if k in known
            else self.builder.input(entry.name, entry.type, entry.shape, varying=entry.varying).ravel()
            for k, entry in enumerate(program.inputs)
        ]


def _simpler(builder: Builder, value: Value, args: tuple[Value, ...]) -> Value | None:
    op = value.op
    if op == "copy":
        return args[0]
    if op in INLINE:
        return lower(builder, op, args)
    if value.type != "f64":
        return None
    if op == "mul" and any(_is(arg, 0.0) for arg in args):
        return builder.constant(0.0, "f64")
    if op != "fma":
        return None
    a, b, c = args
    if _is(a, 0.0) or _is(b, 0.0):
        return c
    for factor, other in ((a, b), (b, a)):
        if _is(factor, 1.0):
            return builder.apply("add", other, c)
        if _is(factor, -1.0):
            return builder.apply("sub", c, other)
    if _is(c, 0.0):
        return builder.apply("mul", a, b)
    if all(arg.op == "const" and np.isfinite(arg.data) for arg in args):
        x, y, z = (Fraction(arg.data) for arg in args)
        return builder.constant(float(x * y + z), "f64")
    return None


def _is(value: Value, number: float) -> bool:
    known: Any = value.data
    return value.op == "const" and bool(known == number)


TRIPLE = "wasm32-unknown-unknown"
FEATURES = "+nontrapping-fptoint,+sign-ext,+bulk-memory,+simd128,+relaxed-simd"
OPTIMISED = 2
"""LLVM's optimisation level for instruction selection, scheduling and locals."""

ENTRY, TWICE, ONCE = "run", "twice_rounded", "once_rounded"
"""The exported function, and the replacements of multiply-adds for a browser without them."""


@dataclass(frozen=True)
class Module:
    """A WebAssembly module, and the layout of its arguments.

    Its only import is the memory, `env.__linear_memory`. The exported function is `run(table, rows)`. `table` is the
    address of an array with the 32-bit addresses of all inputs and then all outputs. `rows` is the number of rows of
    each log. Booleans are stored as bytes, all other types as in C.

    A browser may lack the multiply-add instruction. Each one is then replaced by a call with the same number of bytes:
    in elementary functions, which need it, to a function that rounds once, and elsewhere to one that rounds twice.

    - `bytes`: the module, as in a `.wasm` file; offsets count its bytes from 0.
    - `inputs`: type and number of elements of each input.
    - `outputs`: for each output, its type, its number of elements (in one row of a log), and True if it is a log.
    - `digest`: equal for equal programs and constants.
    - `code`: offsets of the beginning and the end of the code.
    - `entry_at`: offset of the exported function's body, in which multiply-adds may be rounded twice.
    - `once`, `twice`: indices of the functions that replace a multiply-add: the one that rounds once, and the one that
      rounds twice.
    - `others`: offsets at which the bytes equal those of a multiply-add, but are not this instruction.
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
    """Compile a program to a WebAssembly module, without changing the program.

    - `known`: numbers of the inputs that become constants of the module, by position among the program's inputs.

    Raises DefinitionError if llvmlite is missing, or an operation of the program has no code.
    """
    known = known or {}
    with as_native_code_error(lambda: "the program"):
        version, compile = _compiler()
        identity = hashlib.sha256(digest(program).encode())
        for position, array in sorted(known.items()):
            identity.update(f"{position} {array.dtype} {array.shape}".encode() + array.tobytes())
        key = "\n".join([version, TRIPLE, FEATURES, str(OPTIMISED), identity.hexdigest()])
        object = cache.load_code(key)
        if object is None:
            object = compile(_text(substitute_inputs(program, known)))
            cache.store_code(key, object)
    module, indices = with_export(object, ENTRY), functions_of(object)
    functions = list(bodies(module))
    instructions = {start + at for start, body in functions for at in find_multiply_adds(body)}
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
    return "\n".join(
        [
            f'target datalayout = "{_machine().target_data}"',
            f'target triple = "{TRIPLE}"',
            *sorted(body.declarations.union({FUSED}, *(declarations for _, declarations in functions))),
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
    """Return the LLVM IR of an elementary function, and its declarations."""
    program = elementary_program(name)
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
    """Return the compiler's version, and a function from LLVM IR to the bytes of an object file."""
    machine = _machine()
    import llvmlite
    import llvmlite.binding as llvm

    def compile(text: str) -> bytes:
        return bytes(machine.emit_object(llvm.parse_assembly(text)))

    return f"llvmlite {llvmlite.__version__}, LLVM {llvm.llvm_version_info}", compile
