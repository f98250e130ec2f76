"""Numbers of variable length, as WebAssembly writes them."""

from __future__ import annotations


def read(data: bytes, at: int) -> tuple[int, int]:
    """An unsigned number, and where the next thing begins.

    - `data`: the bytes.
    - `at`: where it begins.
    """
    value = shift = 0
    while True:
        byte = data[at]
        at += 1
        value |= (byte & 0x7F) << shift
        shift += 7
        if not byte & 0x80:
            return value, at


def written(value: int) -> bytes:
    """An unsigned number.

    - `value`: it.
    """
    found = bytearray()
    while True:
        byte, value = value & 0x7F, value >> 7
        if not value:
            return bytes([*found, byte])
        found.append(byte | 0x80)
