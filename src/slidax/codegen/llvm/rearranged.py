"""Vectors put together and taken apart."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from slidax.codegen.ir import Type

from .words import TYPES, typed

Write = Callable[[str], None]


def spread(name: str, type: Type, word: str, lanes: int, write: Write) -> None:
    """Writes a vector that has one number in all lanes.

    - `name`: of the vector.
    - `type`, `word`: of the number.
    - `lanes`: how many.
    - `write`: takes a line.
    """
    whole = typed(type, lanes)
    write(f"{name}i = insertelement {whole} poison, {TYPES[type]} {word}, i32 0")
    write(f"{name} = shufflevector {whole} {name}i, {whole} poison, <{lanes} x i32> zeroinitializer")


def gather(name: str, type: Type, words: Sequence[str], write: Write) -> None:
    """Writes a vector of numbers.

    - `name`, `write`: as in `spread`.
    - `type`, `words`: of the numbers.
    """
    whole, before = typed(type, len(words)), "poison"
    for k, word in enumerate(words):
        after = name if k == len(words) - 1 else f"{name}g{k}"
        write(f"{after} = insertelement {whole} {before}, {TYPES[type]} {word}, i32 {k}")
        before = after


def pick(name: str, type: Type, word: str, lanes: int, k: int, write: Write) -> None:
    """Writes a number of a vector.

    - `name`, `type`: of the number.
    - `word`, `lanes`: of the vector.
    - `k`: its place there.
    - `write`: as in `spread`.
    """
    write(f"{name} = extractelement {typed(type, lanes)} {word}, i32 {k}")
