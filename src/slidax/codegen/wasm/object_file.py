"""From LLVM's object file to a module that a browser loads.

A WebAssembly object file is a module already: its memory is imported, its functions have their final numbers, and what
a linker would fill in stands there as it will be. It lacks its exports, and has sections for linkers that nobody else
reads. So one object by itself needs no linker.
"""

from __future__ import annotations

from collections.abc import Iterator

from slidax._errors import DefinitionError

from .leb128 import read, written

MAGIC = b"\0asm\1\0\0\0"
CUSTOM, EXPORT, CODE = 0, 7, 10

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
    label = name.encode()
    which = functions_of(object)[name]
    export = bytes([1]) + written(len(label)) + label + bytes([0]) + written(which)
    kept = [(kind, body) for kind, body in sections if kind != CUSTOM]
    place = sum(kind in BEFORE_EXPORTS for kind, _ in kept)
    kept.insert(place, (EXPORT, export))
    return MAGIC + b"".join(bytes([kind]) + written(len(body)) + body for kind, body in kept)


def bodies(module: bytes) -> Iterator[tuple[int, bytes]]:
    """Where each function's body begins, and the body, in the order of the functions.

    - `module`: or an object file.
    """
    at = len(MAGIC)
    while at < len(module):
        kind = module[at]
        size, start = read(module, at + 1)
        if kind == CODE:
            count, place = read(module, start)
            for _ in range(count):
                length, place = read(module, place)
                yield place, module[place : place + length]
                place += length
        at = start + size


def _sections(object: bytes) -> Iterator[tuple[int, bytes]]:
    at = len(MAGIC)
    while at < len(object):
        kind = object[at]
        size, start = read(object, at + 1)
        yield kind, object[start : start + size]
        at = start + size


def functions_of(object: bytes) -> dict[str, int]:
    """The numbers of the functions that are defined in an object file, by their names.

    - `object`: of one LLVM module.
    """
    for kind, body in _sections(object):
        if kind != CUSTOM:
            continue
        length, at = read(body, 0)
        if body[at : at + length] == b"linking":
            _, at = read(body, at + length)
            while at < len(body):
                part = body[at]
                size, start = read(body, at + 1)
                if part == SYMBOLS:
                    return dict(_functions(body[start : start + size]))
                at = start + size
    return {}


def _functions(table: bytes) -> Iterator[tuple[str, int]]:
    """Those that are defined here, as far as they stand before any other kind of symbol."""
    count, at = read(table, 0)
    for _ in range(count):
        kind = table[at]
        flags, at = read(table, at + 1)
        if kind != FUNCTIONS:
            return
        which, at = read(table, at)
        if not flags & UNDEFINED or flags & EXPLICIT:
            length, at = read(table, at)
            yield table[at : at + length].decode(), which
            at += length
