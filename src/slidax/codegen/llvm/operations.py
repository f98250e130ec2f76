"""LLVM's types, constants and operations, on single numbers and on vectors."""

from __future__ import annotations

import struct
from collections.abc import Sequence

import numpy as np

from slidax.core.errors import DefinitionError

from ..ir import DTYPES, FLOATS, Number, Type, Value

TYPES: dict[Type, str] = {
    "f64": "double",
    "f32": "float",
    "i64": "i64",
    "i32": "i32",
    "u64": "i64",
    "u32": "i32",
    "b1": "i1",
}
"""LLVM types; signedness belongs to the operations."""

STORED: dict[Type, str] = {**TYPES, "b1": "i8"}
"""Types in memory: a boolean fills a byte."""

BYTES: dict[Type, int] = {type: np.dtype(dtype).itemsize for type, dtype in DTYPES.items()}
"""Size of each type in memory [bytes]."""


def type_name(type: Type, lanes: int) -> str:
    """Return the LLVM name of an IR type, such as `double`; for `lanes > 1` of a vector of it: `<8 x double>`."""
    return TYPES[type] if lanes == 1 else f"<{lanes} x {TYPES[type]}>"


def suffix(type: Type, lanes: int) -> str:
    """Return the suffix of an LLVM intrinsic's name for an IR type: `f64`, or `v8f64` for 8 lanes."""
    word = type if type in FLOATS else STORED[type]
    return word if lanes == 1 else f"v{lanes}{word}"


def literal(number: Number, type: Type, lanes: int = 1) -> str:
    """Return a number as an exact LLVM constant of an IR type; for `lanes > 1`, a vector of equal constants."""
    if type in FLOATS:
        # LLVM writes a float by the bits of the double that it equals.
        word = f"0x{struct.unpack('<Q', struct.pack('<d', number))[0]:016X}"
    elif type == "b1":
        word = "true" if number else "false"
    else:
        bits = 8 * BYTES[type]
        word = str((int(number) + (1 << bits - 1)) % (1 << bits) - (1 << bits - 1))
    return word if lanes == 1 else f"splat ({TYPES[type]} {word})"


class Lines:
    """Collection of the lines of one function in LLVM IR.

    - `declarations`: declarations of the functions that it calls.
    """

    def __init__(self) -> None:
        self.lines: list[str] = []
        self.declarations: set[str] = set()

    def write(self, line: str) -> None:
        """Add a line."""
        self.lines.append(line)

    def call(self, name: str, result: str, function: str, *arguments: tuple[str, str]) -> None:
        """Write the call of an LLVM function, and add its declaration.

        - `name`: name of the result; empty for a function without one.
        - `result`: LLVM type of the result.
        - `arguments`: LLVM type and operand of each argument.
        """
        call = f"call {result} @{function}({', '.join(f'{type} {word}' for type, word in arguments)})"
        self.write(f"{name} = {call}" if name else call)
        self.declarations.add(f"declare {result} @{function}({', '.join(type for type, _ in arguments)})")


SIGNED = ("i64", "i32")
FLOAT_WORDS = {"add": "fadd", "sub": "fsub", "mul": "fmul", "div": "fdiv", "rem": "frem"}
INTEGER_WORDS = {"add": "add", "sub": "sub", "mul": "mul", "and": "and", "or": "or", "xor": "xor"}
SHIFTS = {"shl": "shl", "shr": "lshr", "sar": "ashr"}
CALLS = {"sqrt": "sqrt", "floor": "floor", "ceil": "ceil", "rint": "rint", "fma": "fma", "abs": "fabs"}
FLOAT_TESTS = {"eq": "oeq", "ne": "une", "lt": "olt", "le": "ole", "gt": "ogt", "ge": "oge"}


def operation(value: Value, words: Sequence[str], lanes: int, out: Lines) -> None:
    """Write the LLVM IR of one operation: arithmetic, comparison, selection or conversion.

    The result is defined for all arguments, because inactive lanes compute with arbitrary numbers.

    - `value`: the operation. Elementary functions, loops, branches and memory accesses are written elsewhere.
    - `words`: LLVM operands for its arguments, each a vector with this number of lanes, or a scalar.
    - `lanes`: number of lanes (elements of a vector); 1 for a scalar.
    """
    op, name = value.op, f"%v{value.number}"
    source = value.args[0].type if value.args else value.type
    llvm_type = type_name(source, lanes)
    if op == "select":
        yes = type_name(value.type, lanes)
        out.write(f"{name} = select {type_name('b1', lanes)} {words[0]}, {yes} {words[1]}, {yes} {words[2]}")
    elif op in FLOAT_TESTS:
        out.write(f"{name} = {_test(op, source)} {llvm_type} {words[0]}, {words[1]}")
    elif op == "convert":
        _convert(value, words[0], lanes, out)
    elif op == "bitcast":
        out.write(f"{name} = bitcast {llvm_type} {words[0]} to {type_name(value.type, lanes)}")
    elif op == "not":
        out.write(f"{name} = xor {llvm_type} {words[0]}, {literal(1 if source == 'b1' else -1, source, lanes)}")
    elif op == "isfinite":
        _intrinsic(f"{name}s", "fabs", source, words, lanes, out)
        out.write(f"{name} = fcmp olt {llvm_type} {name}s, {literal(float('inf'), source, lanes)}")
    elif op in ("min", "max"):
        _extreme(value, words, lanes, out)
    elif source not in FLOATS:
        _integer(value, words, lanes, out)
    elif op in FLOAT_WORDS:
        out.write(f"{name} = {FLOAT_WORDS[op]} {llvm_type} {words[0]}, {words[1]}")
    elif op == "neg":
        out.write(f"{name} = fneg {llvm_type} {words[0]}")
    else:
        _intrinsic(name, CALLS[op], value.type, words, lanes, out)


def _test(op: str, type: str) -> str:
    if type in FLOATS:
        return f"fcmp {FLOAT_TESTS[op]}"
    if op in ("eq", "ne"):
        return f"icmp {op}"
    return f"icmp {'s' if type in SIGNED else 'u'}{op}"


def _intrinsic(name: str, function: str, type: Type, words: Sequence[str], lanes: int, out: Lines) -> None:
    llvm_type = type_name(type, lanes)
    out.call(name, llvm_type, f"llvm.{function}.{suffix(type, lanes)}", *((llvm_type, word) for word in words))


def _extreme(value: Value, words: Sequence[str], lanes: int, out: Lines) -> None:
    a, b = words
    name, llvm_type, mask = f"%v{value.number}", type_name(value.type, lanes), type_name("b1", lanes)
    if value.args[1].op == "const":
        a, b = b, a  # a comparison with NaN is false and gives b, so that only a must be checked for NaN
    first = value.args[1] if value.args[1].op == "const" else value.args[0]
    known = value.type not in FLOATS or (first.op == "const" and first.data == first.data)
    better = name if known else f"{name}m"
    out.write(f"{name}c = {_test('gt' if value.op == 'max' else 'lt', value.type)} {llvm_type} {a}, {b}")
    out.write(f"{better} = select {mask} {name}c, {llvm_type} {a}, {llvm_type} {b}")
    if not known:
        out.write(f"{name}n = fcmp uno {llvm_type} {a}, {a}")
        out.write(f"{name} = select {mask} {name}n, {llvm_type} {a}, {llvm_type} {better}")


def _integer(value: Value, words: Sequence[str], lanes: int, out: Lines) -> None:
    op, name, llvm_type, mask = value.op, f"%v{value.number}", type_name(value.type, lanes), type_name("b1", lanes)
    signed = value.type in SIGNED
    if op in INTEGER_WORDS:
        out.write(f"{name} = {INTEGER_WORDS[op]} {llvm_type} {words[0]}, {words[1]}")
    elif op == "neg":
        out.write(f"{name} = sub {llvm_type} {literal(0, value.type, lanes)}, {words[0]}")
    elif op == "abs":
        out.write(f"{name}n = sub {llvm_type} {literal(0, value.type, lanes)}, {words[0]}")
        out.write(f"{name}c = icmp slt {llvm_type} {words[0]}, {literal(0, value.type, lanes)}")
        out.write(f"{name} = select {mask} {name}c, {llvm_type} {name}n, {llvm_type} {words[0]}")
    elif op in SHIFTS:
        _shift(value, words, lanes, out)
    elif op in ("div", "rem"):
        # As in XLA: x / 0 is -1, and the remainder is x; the least integer over -1 is itself.
        word = f"{'s' if signed else 'u'}{op}"
        unit, minus = literal(1, value.type, lanes), literal(-1, value.type, lanes)
        out.write(f"{name}z = icmp eq {llvm_type} {words[1]}, {literal(0, value.type, lanes)}")
        unsafe = f"{name}z"
        if signed:
            out.write(f"{name}m = icmp eq {llvm_type} {words[1]}, {minus}")
            out.write(f"{name}u = or {mask} {name}z, {name}m")
            unsafe = f"{name}u"
        out.write(f"{name}y = select {mask} {unsafe}, {llvm_type} {unit}, {llvm_type} {words[1]}")
        out.write(f"{name}q = {word} {llvm_type} {words[0]}, {name}y")
        by_zero = minus if op == "div" else words[0]
        last = f"{name}q"
        if signed and op == "div":
            out.write(f"{name}n = sub {llvm_type} {literal(0, value.type, lanes)}, {words[0]}")
            out.write(f"{name}r = select {mask} {name}m, {llvm_type} {name}n, {llvm_type} {last}")
            last = f"{name}r"
        out.write(f"{name} = select {mask} {name}z, {llvm_type} {by_zero}, {llvm_type} {last}")
    else:
        raise DefinitionError(f"LLVM code cannot be generated for the operation `{op}` of {value.type} numbers")


def _shift(value: Value, words: Sequence[str], lanes: int, out: Lines) -> None:
    name, llvm_type, mask, bits = (
        f"%v{value.number}",
        type_name(value.type, lanes),
        type_name("b1", lanes),
        8 * BYTES[value.type],
    )
    by = value.args[1]
    word = SHIFTS[value.op]
    if by.op == "const" and 0 <= int(by.data) < bits:
        out.write(f"{name} = {word} {llvm_type} {words[0]}, {words[1]}")
        return
    # In LLVM, a shift by the number of bits or more is undefined.
    last = literal(bits - 1, value.type, lanes)
    out.write(f"{name}c = icmp ugt {llvm_type} {words[1]}, {last}")
    out.write(f"{name}b = select {mask} {name}c, {llvm_type} {last}, {llvm_type} {words[1]}")
    if word == "ashr":
        out.write(f"{name} = ashr {llvm_type} {words[0]}, {name}b")
    else:
        out.write(f"{name}r = {word} {llvm_type} {words[0]}, {name}b")
        out.write(f"{name} = select {mask} {name}c, {llvm_type} {literal(0, value.type, lanes)}, {llvm_type} {name}r")


def _convert(value: Value, word: str, lanes: int, out: Lines) -> None:
    source, target = value.args[0].type, value.type
    name, before, after = f"%v{value.number}", type_name(source, lanes), type_name(target, lanes)
    zero = literal(0, source, lanes)
    if target == "b1":
        out.write(f"{name} = {'fcmp une' if source in FLOATS else 'icmp ne'} {before} {word}, {zero}")
    elif source == "b1":
        true, false = literal(1, target, lanes), literal(0, target, lanes)
        out.write(f"{name} = select {before} {word}, {after} {true}, {after} {false}")
    elif source in FLOATS and target in FLOATS:
        out.write(f"{name} = {'fpext' if target == 'f64' else 'fptrunc'} {before} {word} to {after}")
    elif source in FLOATS:
        kind = "fptosi" if target in SIGNED else "fptoui"
        out.call(name, after, f"llvm.{kind}.sat.{suffix(target, lanes)}.{suffix(source, lanes)}", (before, word))
    elif target in FLOATS:
        out.write(f"{name} = {'sitofp' if source in SIGNED else 'uitofp'} {before} {word} to {after}")
    elif BYTES[source] == BYTES[target]:
        out.write(f"{name} = bitcast {before} {word} to {after}")
    elif BYTES[source] > BYTES[target]:
        out.write(f"{name} = trunc {before} {word} to {after}")
    else:
        out.write(f"{name} = {'sext' if source in SIGNED else 'zext'} {before} {word} to {after}")
