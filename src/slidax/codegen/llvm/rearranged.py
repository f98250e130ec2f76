"""Assemble vectors, and extract their elements. In all functions, `write` takes a line."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from slidax.codegen.ir import Type

from .words import TYPES, typed

Write = Callable[[str], None]


def spread(name: str, type: Type, word: str, lanes: int, write: Write) -> None:
    """Write a vector with the number `word` in all lanes."""
    whole = typed(type, lanes)
    write(f"{name}i = insertelement {whole} poison, {TYPES[type]} {word}, i32 0")
    write(f"{name} = shufflevector {whole} {name}i, {whole} poison, <{lanes} x i32> zeroinitializer")


def gather(name: str, type: Type, words: Sequence[str], write: Write) -> None:
    """Write a vector of the numbers `words`."""
    whole, before = typed(type, len(words)), "poison"
    for k, word in enumerate(words):
        after = name if k == len(words) - 1 else f"{name}g{k}"
        write(f"{after} = insertelement {whole} {before}, {TYPES[type]} {word}, i32 {k}")
        before = after


def pick(name: str, type: Type, word: str, lanes: int, k: int, write: Write) -> None:
    """Write the extraction of lane `k` from the vector `word`."""
    write(f"{name} = extractelement {typed(type, lanes)} {word}, i32 {k}")
