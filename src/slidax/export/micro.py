"""A scenario's law for microcontrollers: C code, Makefile, start-up code, and golden tests in emulators."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from slidax.core.writing import write_bytes

from .c_project import CProject, project, write_files, writing
from .c_structures import Member

if TYPE_CHECKING:
    from slidax.scenarios.scenario import Scenario

TARGETS = ("m4f", "m7", "rv64", "linux")
STEPS = 200
"""Steps of the closed loop in the test that counts instructions."""

BARE = ("port.h", "bare.c", "cortex_m.c", "riscv.S", "mps2.ld", "virt.ld")
FILES = {
    "header.h.j2": "{prefix}.h",
    "step.c.j2": "{prefix}.c",
    "scenario.h.j2": "{prefix}_scenario.h",
    "scenario.c.j2": "{prefix}_scenario.c",
    **{f"micro/{file}.j2": file for file in ("Makefile", "README.md", "test.c", "hosted.c", *BARE)},
}
"""Output file of each template."""

TYPES = {"b1": "?", "u32": "<u4", "i32": "<i4", "i64": "<i8", "u64": "<u8"}


def export_micro(
    scenario: Scenario, out: str | Path, *, name: str | None = None, single: bool = False, command: str = ""
) -> CProject:
    """Write a scenario's law as a project for Cortex-M and RISC-V to the folder `out`; existing files are overwritten.

    - `name`, `single`, `command`: as in `export_c`.

    Raises DefinitionError if there is no native code for the law, the name is not valid in C, or the folder cannot be
    written.
    """
    exported = project(scenario, name=name, single=single, command=command)
    write_files(exported, out, FILES, steps=STEPS, targets=TARGETS)
    with writing(out):
        write_bytes(Path(out, "golden.bin"), golden_bytes(exported))
    return exported


def golden_bytes(exported: CProject) -> bytes:
    """Return the golden samples as binary data: their number, bytes per sample, then little-endian C structures."""
    assert exported.golden is not None
    real = "<f4" if exported.real == "float" else "<f8"
    structures = [_structure(members, real) for members in _groups(exported)]
    within = [(f"within_{k}", real, (len(members),)) for k, members in enumerate((exported.outputs, exported.memory))]
    fields: list[Any] = [(f"part_{k}", structure) for k, structure in enumerate(structures)]
    row = np.dtype([*fields, ("status", "<u4"), *within], align=True)
    rows = np.zeros(len(exported.golden.rows), row)
    for k, numbers in enumerate(exported.golden.rows):
        for part, members in enumerate(_groups(exported)):
            for member, values in zip(members, numbers[part], strict=True):
                rows[k][f"part_{part}"][member.name] = values
        rows[k]["status"] = exported.golden.statuses[k]
        for part, allowed in enumerate(exported.golden.within[k]):
            rows[k][f"within_{part}"] = allowed
    return np.array([len(rows), row.itemsize], "<u4").tobytes() + rows.tobytes()


def _groups(exported: CProject) -> tuple[list[Member], ...]:
    return exported.measurement, exported.reference, exported.memory, exported.outputs, exported.memory


def _structure(members: list[Member], real: str) -> np.dtype[Any]:
    """Return the dtype of a C structure, in which each number is aligned to a multiple of its size."""
    return np.dtype([(m.name, TYPES.get(m.type, real), (m.size,) if m.shape else ()) for m in members], align=True)
