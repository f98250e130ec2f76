"""Locate instructions in a module's code."""

from __future__ import annotations

from collections.abc import Iterator

from .leb128 import decode_leb128

MADD = bytes([0xFD, 0x87, 0x02])
"""`f64x2.relaxed_madd`: a product and a sum, rounded once on processors with a fused multiply-add."""

BLOCK, ONE, TWO, NUMBERS = (
    frozenset({0x02, 0x03, 0x04}),
    frozenset({0x0C, 0x0D, 0x10, 0x41, 0x42}),
    0x11,
    {0x43: 4, 0x44: 8},
)


def madds(body: bytes) -> list[int]:
    """Offsets of the multiply-adds in a function's body, which begins with the declarations of its locals."""
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
    """Offset of the next instruction."""
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
