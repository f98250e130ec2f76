"""Damaged files for one reader after the other: `python -m tests.hostile.campaign SEED COUNT [READER ...]`.

Prints one line of JSON for each file on which a reader raised anything but a DefinitionError, or took long, and at the
end one with the number of files and the memory that the process took.
"""

import json
import re
import resource
import sys
import tempfile
import time
import traceback
import warnings
import zlib
from pathlib import Path

import jax
import numpy as np

from slidax import DefinitionError

from .readers import all_readers

NUMBER = re.compile(rb"-?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?")

FIELDS = (
    *(b"", b"nan", b"-inf", b"1e400", b"-0", b"9" * 400, b"9" * 5000, b"0." + b"3" * 5000, b"1,5", b"null", b"true"),
    *(b'"', b"'", b"[" * 200_000, b"{" * 3000, b"x" * 200_000, b"\0", b"\xff\xfe", "\u2028\u202e\U0001f600".encode()),
    *(b"\xed\xa0\x80", b"..", b"/dev/zero", b"&a [*a]", b"<!DOCTYPE a [<!ENTITY b 'c'>]>", b"${pi}"),
    *(b"!!python/object:os.system x", b"=1+1", b"2024-01-01 00:00:00", b"18446744073709551616", b"\r"),
)


def flip(data, rng):
    body = bytearray(data)
    for place in rng.integers(0, len(body), rng.integers(1, 9)):
        body[place] ^= 1 << int(rng.integers(8))
    return bytes(body)


def overwrite(data, rng):
    place = int(rng.integers(len(data)))
    size = int(rng.integers(1, 17))
    filling = (bytes(size), b"\xff" * size, rng.bytes(size))[int(rng.integers(3))]
    return data[:place] + filling + data[place + size :]


def cut(data, rng):
    return data[: int(rng.integers(len(data)))]


def remove(data, rng):
    first, last = sorted(int(place) for place in rng.integers(0, len(data) + 1, 2))
    last = min(last, first + int(rng.integers(1, 200)))
    return data[:first] + data[last:]


def repeat(data, rng):
    first = int(rng.integers(len(data)))
    part = data[first : first + int(rng.integers(1, 200))]
    return data[:first] + part * int(rng.integers(2, 30)) + data[first:]


def replace_number(data, rng):
    numbers = list(NUMBER.finditer(data))
    if not numbers:
        return flip(data, rng)
    chosen = numbers[int(rng.integers(len(numbers)))]
    return data[: chosen.start()] + FIELDS[int(rng.integers(len(FIELDS)))] + data[chosen.end() :]


def replace_field(data, rng):
    words = list(re.finditer(rb"[\w.+-]+", data))
    if not words:
        return flip(data, rng)
    chosen = words[int(rng.integers(len(words)))]
    return data[: chosen.start()] + FIELDS[int(rng.integers(len(FIELDS)))] + data[chosen.end() :]


def insert_field(data, rng):
    place = int(rng.integers(len(data) + 1))
    return data[:place] + FIELDS[int(rng.integers(len(FIELDS)))] + data[place:]


def swap_lines(data, rng):
    lines = data.split(b"\n")
    first, second = rng.integers(0, len(lines), 2)
    lines[first], lines[second] = lines[second], lines[first]
    return b"\n".join(lines)


def encode(data, rng):
    text = data.decode("utf-8", "replace")
    return (
        *(b"\xef\xbb\xbf" + data, b"\xef\xbb\xbf\xef\xbb\xbf" + data, text.encode("utf-16"), text.encode("utf-32")),
        *(text.encode("utf-16-le"), data.replace(b"\n", b"\r\n"), data.replace(b"\n", b"\r")),
        *(data.replace(b"a", b"\xe4"), b"\0" * len(data)),
    )[int(rng.integers(9))]


BYTES = (flip, flip, overwrite, cut, remove, repeat)
TEXT = (*BYTES, replace_number, replace_number, replace_field, replace_field, insert_field, swap_lines, encode)


def damaged(data, rng, *, text):
    kinds = TEXT if text else BYTES
    for _ in range(int(rng.integers(1, 4))):
        data = kinds[int(rng.integers(len(kinds)))](data, rng) if data else data
    return data


SLOWEST = 20.0
"""Seconds of the processor for one file."""


def failures(reader, seed, count):
    """Damaged files on which a reader raises another error than a DefinitionError, or is slow."""
    content = reader.content()
    name = zlib.crc32(reader.name.encode())
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / reader.file
        path.parent.mkdir(parents=True, exist_ok=True)
        reader.prepare(path.parent)
        for number in range(count):
            body = damaged(content, np.random.default_rng([seed, name, number]), text=reader.text)
            path.write_bytes(body)
            began = time.process_time()
            what = ""
            try:
                with warnings.catch_warnings():
                    warnings.simplefilter("ignore")
                    reader.read(path)
            except DefinitionError as error:
                if not str(error).strip():
                    what = "no message"
            except BaseException as error:
                frame = traceback.extract_tb(error.__traceback__)[-1]
                what = f"{type(error).__name__}: {str(error)[:300]} at {frame.filename}:{frame.lineno}"
            took = time.process_time() - began
            if what or took > SLOWEST:
                yield {"reader": reader.name, "seed": seed, "number": number, "what": what, "seconds": took}


def main(arguments):
    jax.config.update("jax_enable_x64", True)
    seed, count, wanted = int(arguments[0]), int(arguments[1]), arguments[2:]
    files = 0
    for reader in all_readers():
        if not wanted or reader.name in wanted:
            for failure in failures(reader, seed, count):
                print(json.dumps(failure), flush=True)
            files += count
    print(json.dumps({"files": files, "megabytes": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1000}))


if __name__ == "__main__":
    main(sys.argv[1:])
