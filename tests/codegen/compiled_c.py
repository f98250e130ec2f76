"""A program printed as a C function, compiled, and called with arrays."""

from __future__ import annotations

import ctypes
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from slidax.codegen import c_code
from slidax.codegen.ir import DTYPES

STRICT = ["-std=c99", "-Wall", "-Wextra", "-Wconversion", "-Wshadow", "-Wdouble-promotion", "-Werror", "-pedantic"]
GUARDS = ["-fsanitize=undefined", "-fno-sanitize-recover=undefined"]
COMPILERS = [name for name in ("gcc", "clang") if shutil.which(name)]

needs_a_compiler = pytest.mark.skipif(not COMPILERS, reason="neither gcc nor clang is installed")


def compiled(program, folder: Path, *, compiler="gcc", real="double", flags=()):
    """Compile the program with warnings as errors; return it as a function of a list of arrays."""
    file = folder / "program.c"
    file.write_text(c_code(program, real=real))
    library = folder / f"program_{compiler}.so"
    command = [compiler, *STRICT, "-O1", "-fPIC", "-shared", *flags, str(file), "-o", str(library), "-lm"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr + file.read_text()
    run = ctypes.CDLL(str(library)).run

    def dtype(type):
        return np.dtype(np.float32) if real == "float" and type == "f64" else np.dtype(DTYPES[type])

    def call(arrays):
        with np.errstate(over="ignore"):
            inputs = [np.ascontiguousarray(x, dtype(i.type)) for x, i in zip(arrays, program.inputs, strict=True)]
        left = [np.zeros(output.shape, dtype(output.type)) for output in program.outputs]
        run(*[ctypes.c_void_p(array.ctypes.data) for array in (*inputs, *left)])
        return left

    return call
