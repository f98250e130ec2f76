"""WebAssembly's binary format: LEB128 numbers, sections and instructions of a module."""

from __future__ import annotations

from collections.abc import Iterator

from slidax.core.errors import DefinitionError


def decode_leb128(data: bytes, at: int) -> tuple[int, int]:
    """Decode the unsigned LEB128 integer at the offset `at` of `data`; return the integer and the offset after it."""
    value = shift = 0
    while True:
        byte = data[at]
        at += 1
        value |= (byte & 0x7F) << shift
        shift += 7
        if not byte & 0x80:
            return value, at


def encode_leb128(value: int) -> bytes:
    """Return the unsigned LEB128 encoding of an integer >= 0."""
    data = bytearray()
    while True:
        byte, value = value & 0x7F, value >> 7
        if not value:
            return bytes([*data, byte])
        data.append(byte | 0x80)


MADD = bytes([0xFD, 0x87, 0x02])
"""`f64x2.relaxed_madd`: product and sum, rounded once on CPUs with a fused multiply-add."""

BLOCK, ONE, TWO, NUMBERS = (
    frozenset({0x02, 0x03, 0x04}),
    frozenset({0x0C, 0x0D, 0x10, 0x41, 0x42}),
    0x11,
    {0x43: 4, 0x44: 8},
)
"""Opcodes followed by a block type, by one index or integer, or by two; float constants, with their size [bytes]."""


def find_multiply_adds(body: bytes) -> list[int]:
    """Return the offsets of all multiply-adds in a function's body, whose bytes begin with its local variables."""
    return [at for at in _instructions(body) if body[at : at + 3] == MADD]


def _instructions(body: bytes) -> Iterator[int]:
    groups, at = decode_leb128(body, 0)
    for _ in range(groups):
        _, at = decode_leb128(body, at)
        at += 1
    while at < len(body):
        yield at
        at = _after(body, at)


def _after(body: bytes, at: int) -> int:
    """Return the offset of the next instruction."""
    op = body[at]
    at += 1
    if op in BLOCK:
        # A block's type is one byte, or an index of variable length.
        return decode_leb128(body, at)[1]
    if op in ONE or 0x20 <= op <= 0x26:
        return decode_leb128(body, at)[1]
    if op == TWO or 0x28 <= op <= 0x3E:
        return decode_leb128(body, decode_leb128(body, at)[1])[1]
    if op in NUMBERS:
        return at + NUMBERS[op]
    if op in (0x3F, 0x40):
        return at + 1
    if op == 0x0E:
        count, at = decode_leb128(body, at)
        for _ in range(count + 1):
            _, at = decode_leb128(body, at)
        return at
    if op == 0x1C:
        count, at = decode_leb128(body, at)
        return at + count
    if op == 0xFC:
        kind, at = decode_leb128(body, at)
        for _ in range(0 if kind <= 7 else 2 if kind in (8, 10, 12, 14) else 1):
            _, at = decode_leb128(body, at)
        return at
    if op == 0xFD:
        return _after_vector(body, *decode_leb128(body, at))
    return at


def _after_vector(body: bytes, kind: int, at: int) -> int:
    if kind <= 11 or kind in (92, 93) or 84 <= kind <= 91:
        at = decode_leb128(body, decode_leb128(body, at)[1])[1]
        return at + 1 if 84 <= kind <= 91 else at
    if kind in (12, 13):
        return at + 16
    return at + 1 if 21 <= kind <= 34 else at


MAGIC = b"\0asm\1\0\0\0"
CUSTOM, EXPORT, CODE = 0, 7, 10

BEFORE_EXPORTS = (1, 2, 3, 4, 5, 13, 6)
"""Sections that precede the exports: types, imports, functions, tables, memories, tags, globals."""

SYMBOLS, FUNCTIONS = 8, 0
"""Subsection of `linking` with the symbol table, and the symbol kind of a function."""

UNDEFINED, EXPLICIT = 0x10, 0x40
"""Flags of a symbol: defined elsewhere; with an explicit name although imported."""


def with_export(object: bytes, name: str) -> bytes:
    """Convert a WebAssembly object file to a module that exports one function; return the module's bytes.

    - `object`: bytes of the object file, compiled from one LLVM module.
    - `name`: name of the function.

    Raises DefinitionError if the object is not WebAssembly.
    """
    if object[:8] != MAGIC:
        raise DefinitionError("not a WebAssembly object file: the magic number is missing")
    label = name.encode()
    export = bytes([1]) + encode_leb128(len(label)) + label + bytes([0]) + encode_leb128(functions_of(object)[name])
    sections = [(kind, body) for _, kind, body in _sections(object) if kind != CUSTOM]
    sections.insert(sum(kind in BEFORE_EXPORTS for kind, _ in sections), (EXPORT, export))
    return MAGIC + b"".join(bytes([kind]) + encode_leb128(len(body)) + body for kind, body in sections)


def bodies(module: bytes) -> Iterator[tuple[int, bytes]]:
    """Yield the offset and bytes of each function's body in a module or object file, in the functions' order."""
    for start, kind, section in _sections(module):
        if kind == CODE:
            count, at = decode_leb128(section, 0)
            for _ in range(count):
                length, at = decode_leb128(section, at)
                yield start + at, section[at : at + length]
                at += length


def _sections(object: bytes) -> Iterator[tuple[int, int, bytes]]:
    """Yield the offset, kind and body of each section."""
    at = len(MAGIC)
    while at < len(object):
        kind = object[at]
        size, start = decode_leb128(object, at + 1)
        yield start, kind, object[start : start + size]
        at = start + size


def functions_of(object: bytes) -> dict[str, int]:
    """Return the indices of the named functions in an object file, by name."""
    for _, kind, body in _sections(object):
        if kind != CUSTOM:
            continue
        length, at = decode_leb128(body, 0)
        if body[at : at + length] == b"linking":
            _, at = decode_leb128(body, at + length)
            while at < len(body):
                part = body[at]
                size, start = decode_leb128(body, at + 1)
                if part == SYMBOLS:
                    return dict(_functions(body[start : start + size]))
                at = start + size
    return {}


def _functions(table: bytes) -> Iterator[tuple[str, int]]:
    """Yield name and index of each named function, up to the first symbol of another kind."""
    count, at = decode_leb128(table, 0)
    for _ in range(count):
        kind = table[at]
        flags, at = decode_leb128(table, at + 1)
        if kind != FUNCTIONS:
            return
        which, at = decode_leb128(table, at)
        if not flags & UNDEFINED or flags & EXPLICIT:
            length, at = decode_leb128(table, at)
            yield table[at : at + length].decode(), which
            at += length
