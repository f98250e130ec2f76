"""LLVM's types, constants and operations, on single numbers and on vectors."""

from __future__ import annotations

import struct
from collections.abc import Callable, Sequence

from slidax.core.errors import DefinitionError

from ..ir import ELEMENTARY, FLOATS, Number, Type, Value

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

BYTES: dict[Type, int] = {"f64": 8, "f32": 4, "i64": 8, "i32": 4, "u64": 8, "u32": 4, "b1": 1}
"""Size of each type in memory."""

SUFFIXES: dict[Type, str] = {"f64": "f64", "f32": "f32", "i64": "i64", "i32": "i32", "u64": "i64", "u32": "i32"}
"""Type suffixes in the names of LLVM's intrinsics."""


def type_name(type: Type, lanes: int) -> str:
    """Return the name of a scalar type, or of a vector type for `lanes > 1`."""
    return TYPES[type] if lanes == 1 else f"<{lanes} x {TYPES[type]}>"


def suffix(type: Type, lanes: int) -> str:
    """Return the suffix of an LLVM intrinsic's name for a type."""
    return SUFFIXES[type] if lanes == 1 else f"v{lanes}{SUFFIXES[type]}"


def literal(number: Number, type: Type, lanes: int = 1) -> str:
    """Return an exact constant, equal in all lanes."""
    if type in FLOATS:
        # LLVM writes a float by the bits of the double that it equals.
        word = f"0x{struct.unpack('<Q', struct.pack('<d', number))[0]:016X}"
    elif type == "b1":
        word = "true" if number else "false"
    else:
        bits = 8 * BYTES[type]
        word = str((int(number) + (1 << bits - 1)) % (1 << bits) - (1 << bits - 1))
    return word if lanes == 1 else f"splat ({TYPES[type]} {word})"


Write = Callable[[str], None]

SIGNED = ("i64", "i32")
FLOAT_WORDS = {"add": "fadd", "sub": "fsub", "mul": "fmul", "div": "fdiv", "rem": "frem"}
INTEGER_WORDS = {"add": "add", "sub": "sub", "mul": "mul", "and": "and", "or": "or", "xor": "xor"}
SHIFTS = {"shl": "shl", "shr": "lshr", "sar": "ashr"}
CALLS = {"sqrt": "sqrt", "floor": "floor", "ceil": "ceil", "rint": "rint", "fma": "fma", "abs": "fabs"}
FLOAT_TESTS = {"eq": "oeq", "ne": "une", "lt": "olt", "le": "ole", "gt": "ogt", "ge": "oge"}
NOT_IN_LIBM = ("erf_inv",)


def operation(value: Value, words: Sequence[str], lanes: int, write: Write) -> set[str]:
    """Write the computation of a value; return the declarations of the functions that it calls.

    The result is defined for all arguments, because inactive lanes compute with arbitrary numbers.

    - `value`: neither a block, a part of one, nor a memory access.
    - `words`: its arguments, with the same number of lanes.
    - `lanes`: 1 for a scalar.
    - `write`: writes a line.

    Raises DefinitionError for a function that is not in libm and was not lowered.
    """
    op, name = value.op, f"%v{value.number}"
    source = value.args[0].type if value.args else value.type
    llvm_type = type_name(source, lanes)
    if op == "select":
        yes = type_name(value.type, lanes)
        write(f"{name} = select {type_name('b1', lanes)} {words[0]}, {yes} {words[1]}, {yes} {words[2]}")
    elif op in FLOAT_TESTS:
        write(f"{name} = {_test(op, source)} {llvm_type} {words[0]}, {words[1]}")
    elif op == "convert":
        return _convert(value, words[0], lanes, write)
    elif op == "bitcast":
        write(f"{name} = bitcast {llvm_type} {words[0]} to {type_name(value.type, lanes)}")
    elif op == "not":
        write(f"{name} = xor {llvm_type} {words[0]}, {literal(1 if source == 'b1' else -1, source, lanes)}")
    elif op == "isfinite":
        size = _call("fabs", value.args[0], words, lanes)
        write(f"{name}s = {size[0]}")
        write(f"{name} = fcmp olt {llvm_type} {name}s, {literal(float('inf'), source, lanes)}")
        return {size[1]}
    elif op in ("min", "max"):
        _extreme(value, words, lanes, write)
    elif op in ELEMENTARY:
        return _call_libm(value, words, lanes, write)
    elif source in FLOATS:
        if op in FLOAT_WORDS:
            write(f"{name} = {FLOAT_WORDS[op]} {llvm_type} {words[0]}, {words[1]}")
        elif op == "neg":
            write(f"{name} = fneg {llvm_type} {words[0]}")
        else:
            call, declaration = _call(CALLS[op], value, words, lanes)
            write(f"{name} = {call}")
            return {declaration}
    else:
        _integer(value, words, lanes, write)
    return set()


def _test(op: str, type: str) -> str:
    if type in FLOATS:
        return f"fcmp {FLOAT_TESTS[op]}"
    if op in ("eq", "ne"):
        return f"icmp {op}"
    return f"icmp {'s' if type in SIGNED else 'u'}{op}"


def _call(function: str, value: Value, words: Sequence[str], lanes: int) -> tuple[str, str]:
    llvm_type = type_name(value.type, lanes)
    full = f"{llvm_type} @llvm.{function}.{suffix(value.type, lanes)}"
    arguments = ", ".join(f"{llvm_type} {word}" for word in words)
    return f"call {full}({arguments})", f"declare {full}({', '.join([llvm_type] * len(words))})"


def _extreme(value: Value, words: Sequence[str], lanes: int, write: Write) -> None:
    a, b = words
    name, llvm_type, mask = f"%v{value.number}", type_name(value.type, lanes), type_name("b1", lanes)
    if value.args[1].op == "const":
        a, b = b, a  # a comparison with NaN is false and gives b, so that only a must be checked for NaN
    first = value.args[1] if value.args[1].op == "const" else value.args[0]
    known = value.type not in FLOATS or (first.op == "const" and first.data == first.data)
    better = name if known else f"{name}m"
    write(f"{name}c = {_test('gt' if value.op == 'max' else 'lt', value.type)} {llvm_type} {a}, {b}")
    write(f"{better} = select {mask} {name}c, {llvm_type} {a}, {llvm_type} {b}")
    if not known:
        write(f"{name}n = fcmp uno {llvm_type} {a}, {a}")
        write(f"{name} = select {mask} {name}n, {llvm_type} {a}, {llvm_type} {better}")


def _integer(value: Value, words: Sequence[str], lanes: int, write: Write) -> None:
    op, name, llvm_type, mask = value.op, f"%v{value.number}", type_name(value.type, lanes), type_name("b1", lanes)
    signed = value.type in SIGNED
    if op in INTEGER_WORDS:
        write(f"{name} = {INTEGER_WORDS[op]} {llvm_type} {words[0]}, {words[1]}")
    elif op == "neg":
        write(f"{name} = sub {llvm_type} {literal(0, value.type, lanes)}, {words[0]}")
    elif op == "abs":
        write(f"{name}n = sub {llvm_type} {literal(0, value.type, lanes)}, {words[0]}")
        write(f"{name}c = icmp slt {llvm_type} {words[0]}, {literal(0, value.type, lanes)}")
        write(f"{name} = select {mask} {name}c, {llvm_type} {name}n, {llvm_type} {words[0]}")
    elif op in SHIFTS:
        _shift(value, words, lanes, write)
    elif op in ("div", "rem"):
        # As in XLA: x / 0 is -1, and the remainder is x; the least integer over -1 is itself.
        word = f"{'s' if signed else 'u'}{op}"
        unit, minus = literal(1, value.type, lanes), literal(-1, value.type, lanes)
        write(f"{name}z = icmp eq {llvm_type} {words[1]}, {literal(0, value.type, lanes)}")
        unsafe = f"{name}z"
        if signed:
            write(f"{name}m = icmp eq {llvm_type} {words[1]}, {minus}")
            write(f"{name}u = or {mask} {name}z, {name}m")
            unsafe = f"{name}u"
        write(f"{name}y = select {mask} {unsafe}, {llvm_type} {unit}, {llvm_type} {words[1]}")
        write(f"{name}q = {word} {llvm_type} {words[0]}, {name}y")
        by_zero = minus if op == "div" else words[0]
        last = f"{name}q"
        if signed and op == "div":
            write(f"{name}n = sub {llvm_type} {literal(0, value.type, lanes)}, {words[0]}")
            write(f"{name}r = select {mask} {name}m, {llvm_type} {name}n, {llvm_type} {last}")
            last = f"{name}r"
        write(f"{name} = select {mask} {name}z, {llvm_type} {by_zero}, {llvm_type} {last}")
    else:
        raise DefinitionError(f"unknown operation `{op}` of {value.type} numbers")


def _shift(value: Value, words: Sequence[str], lanes: int, write: Write) -> None:
    name, llvm_type, mask, bits = (
        f"%v{value.number}",
        type_name(value.type, lanes),
        type_name("b1", lanes),
        8 * BYTES[value.type],
    )
    by = value.args[1]
    word = SHIFTS[value.op]
    if by.op == "const" and 0 <= int(by.data) < bits:
        write(f"{name} = {word} {llvm_type} {words[0]}, {words[1]}")
        return
    # In LLVM, a shift by the number of bits or more is undefined.
    last = literal(bits - 1, value.type, lanes)
    write(f"{name}c = icmp ugt {llvm_type} {words[1]}, {last}")
    write(f"{name}b = select {mask} {name}c, {llvm_type} {last}, {llvm_type} {words[1]}")
    if word == "ashr":
        write(f"{name} = ashr {llvm_type} {words[0]}, {name}b")
    else:
        write(f"{name}r = {word} {llvm_type} {words[0]}, {name}b")
        write(f"{name} = select {mask} {name}c, {llvm_type} {literal(0, value.type, lanes)}, {llvm_type} {name}r")


def _convert(value: Value, word: str, lanes: int, write: Write) -> set[str]:
    source, target = value.args[0].type, value.type
    name, before, after = f"%v{value.number}", type_name(source, lanes), type_name(target, lanes)
    zero = literal(0, source, lanes)
    if target == "b1":
        write(f"{name} = {'fcmp une' if source in FLOATS else 'icmp ne'} {before} {word}, {zero}")
    elif source == "b1":
        true, false = literal(1, target, lanes), literal(0, target, lanes)
        write(f"{name} = select {before} {word}, {after} {true}, {after} {false}")
    elif source in FLOATS and target in FLOATS:
        write(f"{name} = {'fpext' if target == 'f64' else 'fptrunc'} {before} {word} to {after}")
    elif source in FLOATS:
        kind = "fptosi" if target in SIGNED else "fptoui"
        full = f"{after} @llvm.{kind}.sat.{suffix(target, lanes)}.{suffix(source, lanes)}"
        write(f"{name} = call {full}({before} {word})")
        return {f"declare {full}({before})"}
    elif target in FLOATS:
        write(f"{name} = {'sitofp' if source in SIGNED else 'uitofp'} {before} {word} to {after}")
    elif BYTES[source] == BYTES[target]:
        write(f"{name} = bitcast {before} {word} to {after}")
    elif BYTES[source] > BYTES[target]:
        write(f"{name} = trunc {before} {word} to {after}")
    else:
        write(f"{name} = {'sext' if source in SIGNED else 'zext'} {before} {word} to {after}")
    return set()


def _call_libm(value: Value, words: Sequence[str], lanes: int, write: Write) -> set[str]:
    """Call the C library's function lane by lane, since vector versions round differently on different machines."""
    if value.op in NOT_IN_LIBM:
        raise DefinitionError(f"`{value.op}` is not in libm: lower it to simpler operations first")
    name, number, llvm_type = f"%v{value.number}", type_name(value.type, 1), type_name(value.type, lanes)
    full = f"{number} @{value.op}{'f' if value.type == 'f32' else ''}"
    if lanes == 1:
        write(f"{name} = call {full}({', '.join(f'{number} {word}' for word in words)})")
    before = "poison"
    for k in range(lanes if lanes > 1 else 0):
        for j, word in enumerate(words):
            write(f"{name}a{j}l{k} = extractelement {llvm_type} {word}, i32 {k}")
        arguments = ", ".join(f"{number} {name}a{j}l{k}" for j in range(len(words)))
        write(f"{name}l{k} = call {full}({arguments})")
        after = name if k == lanes - 1 else f"{name}w{k}"
        write(f"{after} = insertelement {llvm_type} {before}, {number} {name}l{k}, i32 {k}")
        before = after
    return {f"declare {full}({', '.join([number] * len(words))}) #1"}
