"""Machine code and the arrays it works on, in one block of memory; a process needs no JAX to run it."""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

ALIGNED = 64
"""Bytes: a cache line, and the strictest alignment of a vector load."""


@dataclass(frozen=True)
class Slot:
    """Place of an array in the block; `offset` in bytes."""

    offset: int
    shape: tuple[int, ...]
    dtype: str

    @property
    def end(self) -> int:
        """End of the array in the block [bytes]."""
        return self.offset + int(np.prod(self.shape, dtype=int)) * np.dtype(self.dtype).itemsize


@dataclass(frozen=True)
class Coded:
    """Machine code with the places that it reads and writes.

    - `object`: an object file for this machine.
    - `entry`: the name of its function.
    - `offsets`: of all inputs and then of all outputs in the block [bytes]; no output is an input.
    """

    object: bytes
    entry: str
    offsets: tuple[int, ...]


@dataclass(frozen=True)
class Plan:
    """Description of an arena, which one process sends to another.

    - `initial`: the block before the first call.
    - `routines`, `views`: machine code and arrays, by name.
    - `regions`: start and end of parts of the block [bytes], by name.
    """

    initial: bytes
    routines: dict[str, Coded]
    views: dict[str, Slot]
    regions: dict[str, tuple[int, int]]


class Arena:
    """The block in this process, with its code ready to be called; a call costs less than 1 µs in addition to its work.

    Raises ImportError if llvmlite is missing.
    """

    def __init__(self, plan: Plan) -> None:
        self.plan = plan
        whole = np.zeros(len(plan.initial) + ALIGNED, np.uint8)
        start = -whole.ctypes.data % ALIGNED
        self.block = whole[start : start + len(plan.initial)]
        self.reset()
        self._address = self.block.ctypes.data
        self._linked = _linked(plan)
        self._tables = {
            name: np.array([self._address + offset for offset in code.offsets], np.uintp)
            for name, code in plan.routines.items()
        }

    def reset(self) -> None:
        """Restore the initial block."""
        self.block[:] = np.frombuffer(self.plan.initial, np.uint8)

    def view(self, name: str) -> np.ndarray:
        """Return an array in the block."""
        slot = self.plan.views[name]
        return self.block[slot.offset : slot.end].view(slot.dtype).reshape(slot.shape)

    def region(self, name: str) -> np.ndarray:
        """Return a part of the block as bytes."""
        start, end = self.plan.regions[name]
        return self.block[start:end]

    def routine(self, name: str) -> Callable[[], None]:
        """Return machine code that is called without arguments."""
        code = self.plan.routines[name]
        return partial(self._linked[code.entry], self._tables[name].ctypes.data, 1, 0)


def _linked(plan: Plan) -> dict[str, Any]:
    """Link each function once; by the name of its entry."""
    import llvmlite.binding as llvm

    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    target = llvm.Target.from_default_triple().create_target_machine(reloc="pic", codemodel="small")
    jit = llvm.create_lljit_compiler(target, use_jit_link=True)
    signature = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_int64, ctypes.c_int64)
    functions: dict[str, Any] = {}
    for code in plan.routines.values():
        if code.entry in functions:
            continue
        builder = llvm.JITLibraryBuilder().add_object_img(code.object).add_current_process()
        library = builder.export_symbol(code.entry).link(jit, f"of_{code.entry}")
        function: Any = signature(library[code.entry])
        # The code lives as long as its holder.
        function.held = (jit, library)
        functions[code.entry] = function
    return functions
