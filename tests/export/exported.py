"""An exported step, compiled and called from here."""

import ctypes
import re
import shutil
import subprocess
from typing import NamedTuple

import jax
import numpy as np
import pytest

from slidax.export.c_project import project
from slidax.export.c_structures import render
from slidax.export.onboard.pilot import CompiledLaw
from tests.codegen.compiled_c import COMPILERS as COMPILERS
from tests.codegen.compiled_c import needs_a_compiler as needs_a_compiler

STRICT = ("-std=c99", "-Wall", "-Wextra", "-Wconversion", "-Wshadow", "-Werror", "-pedantic")
TYPES = {"b1": "?", "u32": "u4", "i32": "i4", "i64": "i8", "u64": "u8"}

DRIVER = """
#include "{p}.h"
static {p}_state state;
void forget(void)
{{
    {p}_reset(&state);
}}
void many(long count, const {p}_measurement *m, const {p}_reference *r, const {p}_memory *before,
          const {p}_parameters *p, {p}_command *c, {p}_memory *after, uint32_t *status)
{{
    long k;
    for (k = 0; k < count; ++k) {{
        state.memory = before[k];
        status[k] = {p}_step(&m[k], &r[k], &state, p, &c[k]);
        after[k] = state.memory;
    }}
}}
"""

needs_cmake = pytest.mark.skipif(not (shutil.which("cmake") and shutil.which("g++")), reason="cmake or g++ is not here")


class Answers(NamedTuple):
    command: np.ndarray
    memory: np.ndarray
    status: np.ndarray


class Exported:
    def __init__(self, scenario, folder, *, single=False, written=False):
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

    def parameters(self, guard=None):
        if guard is not None:
            return self._filled("parameters", jax.tree.map(lambda x: x[None], guard))
        result = np.zeros(1, self.types["parameters"])
        self.library[f"{self.project.prefix}_parameters_default"](at(result))
        return result

    def answers(self, samples, parameters=None, *, fresh=True):
        """Answers to the samples, each with its own memory.

        - `fresh`: False keeps the values that the previous call computed from its parameters.
        """
        measurement = self._filled("measurement", (samples.t, samples.state))
        reference = self._filled("reference", (samples.now, samples.following))
        before = self._filled("memory", samples.memory)
        count = len(measurement)
        result = Answers(
            np.zeros(count, self.types["outputs"]), np.zeros(count, self.types["memory"]), np.zeros(count, np.uint32)
        )
        defaults = self.parameters() if parameters is None else parameters
        if fresh:
            self.library.forget()
        self.library.many(ctypes.c_long(count), *map(at, (measurement, reference, before, defaults, *result)))
        return result

    def _filled(self, name, tree):
        leaves = [np.asarray(leaf) for leaf in jax.tree.leaves(tree)]
        result = np.zeros(len(leaves[0]), self.types[name])
        for field, leaf in zip(self.types[name].names or (), leaves, strict=True):
            result[field] = leaf.reshape(result[field].shape)
        return result


def write_law(law, folder):
    for template, ending in (("header.h.j2", ".h"), ("step.c.j2", ".c")):
        (folder / f"{law.prefix}{ending}").write_text(render(template, {"x": law}))


def compiled(compiler, folder, *arguments):
    run(folder, compiler, *STRICT, *arguments)


def run(folder, *command):
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, f"{' '.join(command)}\n{done.stdout[-3000:]}\n{done.stderr[-3000:]}"
    return done.stdout


def quickly_compiled(folder):
    """A robot's compiled law without optimisation."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("CFLAGS", "-O0")
        return CompiledLaw(folder)


def shorten(pilot, seconds):
    """Shorten each part of the pilot's motion."""
    path = pilot.options.path
    path.hold = path.small = path.widen = path.motion = seconds


def allow_error(pilot, size):
    for name in ("error_hold", "error_small", "error_full"):
        getattr(pilot.options, name)[:] = [size] * len(pilot.reference.q)


def structure(members, real):
    return np.dtype([(m.name, TYPES.get(m.type, real), (m.size,) if m.shape else ()) for m in members], align=True)


def at(array):
    return ctypes.c_void_p(array.ctypes.data)


def copied_with_a_wrong_answer(folder, copy):
    """Copy a project to another folder, with a relative error of 1e-9 in the first sliding variable."""
    for file in folder.iterdir():
        if file.is_file():
            shutil.copy(file, copy)
    source = copy / "slidax_law.c"
    wrong, count = re.subn(r"(command->s\[0\] = )(.*);", r"\1(\2) * (1.0 + 1e-9);", source.read_text())
    assert count == 1
    source.write_text(wrong)
