"""From LLVM's object file to a module that a browser loads.

A WebAssembly object file is a module already: its memory is imported, its functions have their final numbers, and what
a linker would fill in stands there as it will be. It lacks its exports, and has sections for linkers that nobody else
reads. So one object by itself needs no linker.
"""

from __future__ import annotations

from collections.abc import Iterator

from slidax._errors import DefinitionError

MAGIC = b"\0asm\1\0\0\0"
CUSTOM, EXPORT = 0, 7

BEFORE_EXPORTS = (1, 2, 3, 4, 5, 13, 6)
"""Sections that come first: types, imports, functions, tables, memories, tags, globals."""

SYMBOLS, FUNCTIONS = 8, 0
"""Of the section `linking`: its part with the names, and the kind of a name."""

UNDEFINED, EXPLICIT = 0x10, 0x40
"""Flags of a name: it is defined elsewhere; it is written out although it is imported."""


def with_export(object: bytes, name: str) -> bytes:
    """The module with one function that can be called from outside.

    - `object`: of one LLVM module.
    - `name`: of the function.

    Raises DefinitionError if the object is something else, or has no such function.
    """
    if object[:8] != MAGIC:
        raise DefinitionError("this is no WebAssembly")
    sections = list(_sections(object))
    which = _function(sections, name)
    label = name.encode()
    export = bytes([1]) + _number(len(label)) + label + bytes([0]) + _number(which)
    kept = [(kind, body) for kind, body in sections if kind != CUSTOM]
    place = sum(kind in BEFORE_EXPORTS for kind, _ in kept)
    kept.insert(place, (EXPORT, export))
    return MAGIC + b"".join(bytes([kind]) + _number(len(body)) + body for kind, body in kept)


def _sections(object: bytes) -> Iterator[tuple[int, bytes]]:
    at = len(MAGIC)
    while at < len(object):
        kind = object[at]
        size, start = _read(object, at + 1)
        yield kind, object[start : start + size]
        at = start + size


def _function(sections: list[tuple[int, bytes]], name: str) -> int:
    for kind, body in sections:
        if kind != CUSTOM:
            continue
        length, at = _read(body, 0)
        if body[at : at + length] == b"linking":
            _, at = _read(body, at + length)
            while at < len(body):
                part = body[at]
                size, start = _read(body, at + 1)
                if part == SYMBOLS:
                    found = dict(_functions(body[start : start + size]))
                    if name in found:
                        return found[name]
                at = start + size
    raise DefinitionError(f"the object file has no function `{name}`")


def _functions(table: bytes) -> Iterator[tuple[str, int]]:
    """Those that are defined here, as far as they stand before any other kind of symbol."""
    count, at = _read(table, 0)
    for _ in range(count):
        kind = table[at]
        flags, at = _read(table, at + 1)
        if kind != FUNCTIONS:
            return
        which, at = _read(table, at)
        if not flags & UNDEFINED or flags & EXPLICIT:
            length, at = _read(table, at)
            yield table[at : at + length].decode(), which
            at += length


def _read(data: bytes, at: int) -> tuple[int, int]:
    """An unsigned number in LEB128, and where the next thing begins."""
    value = shift = 0
    while True:
        byte = data[at]
        at += 1
        value |= (byte & 0x7F) << shift
        shift += 7
        if not byte & 0x80:
            return value, at


def _number(value: int) -> bytes:
    found = bytearray()
    while True:
        byte, value = value & 0x7F, value >> 7
        if not value:
            return bytes([*found, byte])
        found.append(byte | 0x80)
