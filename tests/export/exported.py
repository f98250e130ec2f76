"""An exported step, compiled and called from here."""

from __future__ import annotations

import ctypes
import shutil
import subprocess
from pathlib import Path
from typing import Any, NamedTuple

import jax
import numpy as np
import pytest

from slidax.export.c_project import CProject, project
from slidax.export.c_structures import Member, render
from slidax.export.golden_samples import StepSample

COMPILERS = [name for name in ("gcc", "clang") if shutil.which(name)]
STRICT = ("-std=c99", "-Wall", "-Wextra", "-Wconversion", "-Wshadow", "-Werror", "-pedantic")
TYPES = {"b1": "?", "u32": "u4", "i32": "i4", "i64": "i8", "u64": "u8"}

DRIVER = """
#include "{p}.h"
void many(long count, const {p}_measurement *m, const {p}_reference *r, const {p}_memory *before,
          const {p}_parameters *p, {p}_command *c, {p}_memory *after, uint32_t *status)
{{
    {p}_state state;
    long k;
    {p}_reset(&state);
    for (k = 0; k < count; ++k) {{
        state.memory = before[k];
        status[k] = {p}_step(&m[k], &r[k], &state, p, &c[k]);
        after[k] = state.memory;
    }}
}}
"""

needs_a_compiler = pytest.mark.skipif(not COMPILERS, reason="neither gcc nor clang is here")


class Answers(NamedTuple):
    """What the step says to samples, as arrays of structures."""

    command: np.ndarray
    memory: np.ndarray
    status: np.ndarray


class Exported:
    """A scenario's step in C, as a shared library."""

    def __init__(self, scenario: Any, folder: Path, *, single: bool = False, written: bool = False) -> None:
        self.project = project(scenario, name="law", single=single, with_golden=False)
        real = "f4" if single else "f8"
        self.types = {
            name: structure(getattr(self.project, name), real)
            for name in ("measurement", "reference", "memory", "outputs", "parameters")
        }
        if not written:
            write_law(self.project, folder)
        (folder / "driver.c").write_text(DRIVER.format(p=self.project.prefix))
        compiled(COMPILERS[0], folder, "slidax_law.c", "driver.c", "-shared", "-fPIC", "-O1", "-o", "law.so", "-lm")
        self.library = ctypes.CDLL(str(folder / "law.so"))

    def parameters(self, guard: Any = None) -> np.ndarray:
        """The defaults as C has them, or those of another guarded step."""
        if guard is not None:
            return self._filled("parameters", jax.tree.map(lambda x: x[None], guard))
        found = np.zeros(1, self.types["parameters"])
        self.library[f"{self.project.prefix}_parameters_default"](at(found))
        return found

    def answers(self, samples: StepSample, parameters: np.ndarray | None = None) -> Answers:
        """The commands, the memories after them and the statuses."""
        measurement = self._filled("measurement", (samples.t, samples.state))
        reference = self._filled("reference", (samples.now, samples.following))
        before = self._filled("memory", samples.memory)
        count = len(measurement)
        found = Answers(
            np.zeros(count, self.types["outputs"]), np.zeros(count, self.types["memory"]), np.zeros(count, np.uint32)
        )
        given = self.parameters() if parameters is None else parameters
        self.library.many(ctypes.c_long(count), *map(at, (measurement, reference, before, given, *found)))
        return found

    def _filled(self, name: str, tree: Any) -> np.ndarray:
        leaves = [np.asarray(leaf) for leaf in jax.tree.leaves(tree)]
        found = np.zeros(len(leaves[0]), self.types[name])
        for field, leaf in zip(self.types[name].names or (), leaves, strict=True):
            found[field] = leaf.reshape(found[field].shape)
        return found


def write_law(made: CProject, folder: Path) -> None:
    """The header and the source alone, which need no golden samples."""
    for template, ending in (("header.h.j2", ".h"), ("step.c.j2", ".c")):
        (folder / f"{made.prefix}{ending}").write_text(render(template, {"x": made}))


def compiled(compiler: str, folder: Path, *arguments: str) -> None:
    """Runs a C compiler with all warnings as errors."""
    run(folder, compiler, *STRICT, *arguments)


def run(folder: Path, *command: str) -> str:
    """Runs a command that must succeed; what it prints."""
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, f"{' '.join(command)}\n{done.stdout[-3000:]}\n{done.stderr[-3000:]}"
    return done.stdout


def structure(members: list[Member], real: str) -> np.dtype:
    return np.dtype([(m.name, TYPES.get(m.type, real), (m.size,) if m.shape else ()) for m in members], align=True)


def at(array: np.ndarray) -> ctypes.c_void_p:
    return ctypes.c_void_p(array.ctypes.data)
