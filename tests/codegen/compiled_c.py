"""A program printed as a C function, compiled, and called with arrays."""

from __future__ import annotations

import ctypes
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from slidax.codegen.c import Dialect, statements
from slidax.codegen.fold import DTYPES

STRICT = ["-std=c99", "-Wall", "-Wextra", "-Wconversion", "-Wshadow", "-Wdouble-promotion", "-Werror", "-pedantic"]
GUARDS = ["-fsanitize=undefined", "-fno-sanitize-recover=undefined"]
COMPILERS = [name for name in ("gcc", "clang") if shutil.which(name)]

needs_a_compiler = pytest.mark.skipif(not COMPILERS, reason="neither gcc nor clang is installed")


def function_text(program, real="double", **options):
    """The C file of `void run(const double *x0, ..., double *y0, ...)`."""
    dialect = Dialect(real)
    body = statements(
        program,
        [(f"y{k}[{i}]", value) for k, output in enumerate(program.outputs) for i, value in enumerate(output.values)],
        lambda k, element: f"x{k}[{element}]",
        dialect=dialect,
        taken={f"{letter}{k}" for letter in "xy" for k in range(99)},
        **options,
    )
    arguments = [f"const {dialect.type(entry.type)} *x{k}" for k, entry in enumerate(program.inputs)]
    arguments += [f"{dialect.type(entry.type)} *y{k}" for k, entry in enumerate(program.outputs)]
    unused = [f"    (void)x{k};" for k in range(len(program.inputs)) if k not in body.reads]
    head = ["#include <math.h>", "#include <stdbool.h>", "#include <stdint.h>", ""]
    return "\n".join(
        [
            *head,
            *body.helpers.lines,
            f"void run({', '.join(arguments)});",
            f"void run({', '.join(arguments)})\n{{",
            *unused,
            *body.lines,
            "}\n",
        ]
    )


def compiled(program, folder: Path, *, compiler="gcc", real="double", flags=()):
    """The program as a function of a list of arrays, by a C compiler that takes every warning for an error."""
    file = folder / "program.c"
    file.write_text(function_text(program, real))
    library = folder / f"program_{compiler}.so"
    command = [compiler, *STRICT, "-O1", "-fPIC", "-shared", *flags, str(file), "-o", str(library), "-lm"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr + file.read_text()
    run = ctypes.CDLL(str(library)).run

    def dtype(type):
        return np.dtype(np.float32) if real == "float" and type == "f64" else np.dtype(DTYPES[type])

    def call(arrays):
        with np.errstate(over="ignore"):
            given = [np.ascontiguousarray(x, dtype(i.type)) for x, i in zip(arrays, program.inputs, strict=True)]
        left = [np.zeros(output.shape, dtype(output.type)) for output in program.outputs]
        run(*[ctypes.c_void_p(array.ctypes.data) for array in (*given, *left)])
        return left

    return call
