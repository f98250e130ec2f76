"""Turn LLVM's object file into a module that a browser loads.

A WebAssembly object file is nearly a module: its memory is imported, and its functions have their final indices and
relocations. It lacks the exports, and has custom sections that only linkers read. A single object needs no linker.
"""

from __future__ import annotations

from collections.abc import Iterator

from slidax._errors import DefinitionError

from .leb128 import decode_leb128, encode_leb128

MAGIC = b"\0asm\1\0\0\0"
CUSTOM, EXPORT, CODE = 0, 7, 10

BEFORE_EXPORTS = (1, 2, 3, 4, 5, 13, 6)
"""Sections that precede the exports: types, imports, functions, tables, memories, tags, globals."""

SYMBOLS, FUNCTIONS = 8, 0
"""Subsection of `linking` with the symbol table, and the symbol kind of a function."""

UNDEFINED, EXPLICIT = 0x10, 0x40
"""Flags of a symbol: defined elsewhere; named explicitly although imported."""


def with_export(object: bytes, name: str) -> bytes:
    """Return the module of an object file, with one function exported.

    - `object`: object file of one LLVM module.
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
    """Offset and bytes of each function's body in a module or object file, in the functions' order."""
    for start, kind, section in _sections(module):
        if kind == CODE:
            count, at = decode_leb128(section, 0)
            for _ in range(count):
                length, at = decode_leb128(section, at)
                yield start + at, section[at : at + length]
                at += length


def _sections(object: bytes) -> Iterator[tuple[int, int, bytes]]:
    """Offset, kind and body of each section."""
    at = len(MAGIC)
    while at < len(object):
        kind = object[at]
        size, start = decode_leb128(object, at + 1)
        yield start, kind, object[start : start + size]
        at = start + size


def functions_of(object: bytes) -> dict[str, int]:
    """Indices of the functions that an object file defines, by name."""
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
    """Functions that are defined here, up to the first symbol of another kind."""
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
