"""Types and constants in LLVM IR."""

from __future__ import annotations

import struct

from slidax.codegen.ir import FLOATS, Number, Type

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


def typed(type: Type, lanes: int) -> str:
    """Return the name of a scalar type, or of a vector type for `lanes > 1`."""
    return TYPES[type] if lanes == 1 else f"<{lanes} x {TYPES[type]}>"


def suffix(type: Type, lanes: int) -> str:
    """Return the suffix of an LLVM intrinsic's name for a type."""
    return SUFFIXES[type] if lanes == 1 else f"v{lanes}{SUFFIXES[type]}"


def literal(number: Number, type: Type, lanes: int = 1) -> str:
    """Return an exact constant, the same in all lanes."""
    if type in FLOATS:
        # A float is also written with the bits of the double that it equals.
        word = f"0x{struct.unpack('<Q', struct.pack('<d', number))[0]:016X}"
    elif type == "b1":
        word = "true" if number else "false"
    else:
        bits = 8 * BYTES[type]
        word = str((int(number) + (1 << bits - 1)) % (1 << bits) - (1 << bits - 1))
    return word if lanes == 1 else f"splat ({TYPES[type]} {word})"
