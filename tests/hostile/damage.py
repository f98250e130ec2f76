"""Damage done to files: bytes, fields, cuts, numbers, brackets and encodings, all from one generator of numbers."""

from __future__ import annotations

import re

import numpy as np

NUMBER = re.compile(rb"-?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?")

FIELDS = (
    b"",
    b"nan",
    b"-inf",
    b"1e400",
    b"-0",
    b"9" * 400,
    b"9" * 5000,
    b"0." + b"3" * 5000,
    b"1,5",
    b"null",
    b"true",
    b'"',
    b"'",
    b"[" * 200_000,
    b"{" * 3000,
    b"x" * 200_000,
    b"\0",
    b"\xff\xfe",
    "\u2028\u202e\U0001f600".encode(),
    b"\xed\xa0\x80",
    b"..",
    b"/dev/zero",
    b"&a [*a]",
    b"<!DOCTYPE a [<!ENTITY b 'c'>]>",
    b"${pi}",
    b"!!python/object:os.system x",
    b"=1+1",
    b"2024-01-01 00:00:00",
    b"18446744073709551616",
    b"\r",
)


def flip(data: bytes, rng: np.random.Generator) -> bytes:
    body = bytearray(data)
    for place in rng.integers(0, len(body), rng.integers(1, 9)):
        body[place] ^= 1 << int(rng.integers(8))
    return bytes(body)


def overwrite(data: bytes, rng: np.random.Generator) -> bytes:
    place = int(rng.integers(len(data)))
    size = int(rng.integers(1, 17))
    filling = (bytes(size), b"\xff" * size, rng.bytes(size))[int(rng.integers(3))]
    return data[:place] + filling + data[place + size :]


def cut(data: bytes, rng: np.random.Generator) -> bytes:
    return data[: int(rng.integers(len(data)))]


def remove(data: bytes, rng: np.random.Generator) -> bytes:
    first, last = sorted(int(place) for place in rng.integers(0, len(data) + 1, 2))
    last = min(last, first + int(rng.integers(1, 200)))
    return data[:first] + data[last:]


def repeat(data: bytes, rng: np.random.Generator) -> bytes:
    first = int(rng.integers(len(data)))
    part = data[first : first + int(rng.integers(1, 200))]
    return data[:first] + part * int(rng.integers(2, 30)) + data[first:]


def replace_number(data: bytes, rng: np.random.Generator) -> bytes:
    numbers = list(NUMBER.finditer(data))
    if not numbers:
        return flip(data, rng)
    chosen = numbers[int(rng.integers(len(numbers)))]
    return data[: chosen.start()] + FIELDS[int(rng.integers(len(FIELDS)))] + data[chosen.end() :]


def replace_field(data: bytes, rng: np.random.Generator) -> bytes:
    """One entry of a line, a word or a text in quotation marks."""
    words = list(re.finditer(rb"[\w.+-]+", data))
    if not words:
        return flip(data, rng)
    chosen = words[int(rng.integers(len(words)))]
    return data[: chosen.start()] + FIELDS[int(rng.integers(len(FIELDS)))] + data[chosen.end() :]


def insert_field(data: bytes, rng: np.random.Generator) -> bytes:
    place = int(rng.integers(len(data) + 1))
    return data[:place] + FIELDS[int(rng.integers(len(FIELDS)))] + data[place:]


def swap_lines(data: bytes, rng: np.random.Generator) -> bytes:
    lines = data.split(b"\n")
    first, second = rng.integers(0, len(lines), 2)
    lines[first], lines[second] = lines[second], lines[first]
    return b"\n".join(lines)


def encode(data: bytes, rng: np.random.Generator) -> bytes:
    text = data.decode("utf-8", "replace")
    return (
        b"\xef\xbb\xbf" + data,
        b"\xef\xbb\xbf\xef\xbb\xbf" + data,
        text.encode("utf-16"),
        text.encode("utf-32"),
        text.encode("utf-16-le"),
        data.replace(b"\n", b"\r\n"),
        data.replace(b"\n", b"\r"),
        data.replace(b"a", b"\xe4"),
        b"\0" * len(data),
    )[int(rng.integers(9))]


BYTES = (flip, flip, overwrite, cut, remove, repeat)
TEXT = (*BYTES, replace_number, replace_number, replace_field, replace_field, insert_field, swap_lines, encode)


def damaged(data: bytes, rng: np.random.Generator, *, text: bool) -> bytes:
    """The data with one to three kinds of damage."""
    kinds = TEXT if text else BYTES
    for _ in range(int(rng.integers(1, 4))):
        data = kinds[int(rng.integers(len(kinds)))](data, rng) if data else data
    return data
