"""Unsigned integers of variable length (LEB128), as in WebAssembly."""

from __future__ import annotations


def decode_leb128(data: bytes, at: int) -> tuple[int, int]:
    """Return the integer at an offset, and the offset behind it."""
    value = shift = 0
    while True:
        byte = data[at]
        at += 1
        value |= (byte & 0x7F) << shift
        shift += 7
        if not byte & 0x80:
            return value, at


def encode_leb128(value: int) -> bytes:
    """Return the bytes of an integer."""
    data = bytearray()
    while True:
        byte, value = value & 0x7F, value >> 7
        if not value:
            return bytes([*data, byte])
        data.append(byte | 0x80)
