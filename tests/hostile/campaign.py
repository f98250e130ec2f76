"""Damaged files for one reader after the other: `python -m tests.hostile.campaign SEED COUNT [READER ...]`.

Prints one line of JSON for each file on which a reader raised anything but a DefinitionError, or took long, and at the
end one with the number of files and the memory that the process took.
"""

from __future__ import annotations

import json
import resource
import sys
import tempfile
import time
import traceback
import warnings
import zlib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import jax
import numpy as np

from slidax import DefinitionError

from .damage import damaged
from .readers import Reader, all_readers

SLOWEST = 20.0
"""Seconds of the processor for one file."""


def failures(reader: Reader, seed: int, count: int) -> Iterator[dict[str, Any]]:
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


def main(arguments: Sequence[str]) -> None:
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
