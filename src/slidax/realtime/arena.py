"""Machine code and the numbers it works on, in one block of memory: what a process needs that knows no JAX."""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

ALIGNED = 64
"""Bytes: a cache line, and what any vector of the processor may ask for."""


@dataclass(frozen=True)
class Slot:
    """An array's place in the block.

    - `offset`: where it begins [bytes].
    - `shape`, `dtype`: its own.
    """

    offset: int
    shape: tuple[int, ...]
    dtype: str

    @property
    def end(self) -> int:
        """Where it ends [bytes]."""
        return self.offset + int(np.prod(self.shape, dtype=int)) * np.dtype(self.dtype).itemsize


@dataclass(frozen=True)
class Coded:
    """Machine code with the places that it reads and writes.

    - `object`: an object file for this machine.
    - `entry`: the name of its function.
    - `offsets`: of all inputs and then of all outputs, in the block [bytes]; no output is an input.
    """

    object: bytes
    entry: str
    offsets: tuple[int, ...]


@dataclass(frozen=True)
class Plan:
    """All that an arena is made from; it goes from one process to another.

    - `initial`: the block before the first call.
    - `routines`: machine code by name.
    - `views`: arrays by name.
    - `regions`: where parts of the block begin and end [bytes], by name.
    """

    initial: bytes
    routines: dict[str, Coded]
    views: dict[str, Slot]
    regions: dict[str, tuple[int, int]]


class Arena:
    """The block in this process, with its code ready to be called: a call takes less than 1 us beside its work.

    - `plan`: what it is made from.

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
        """The block as it was at first."""
        self.block[:] = np.frombuffer(self.plan.initial, np.uint8)

    def view(self, name: str) -> np.ndarray:
        """An array in the block.

        - `name`: of the view.
        """
        slot = self.plan.views[name]
        return self.block[slot.offset : slot.end].view(slot.dtype).reshape(slot.shape)

    def region(self, name: str) -> np.ndarray:
        """A part of the block, as bytes.

        - `name`: of the region.
        """
        start, end = self.plan.regions[name]
        return self.block[start:end]

    def routine(self, name: str) -> Callable[[], None]:
        """Machine code, to be called without arguments.

        - `name`: of the routine.
        """
        code = self.plan.routines[name]
        return partial(self._linked[code.entry], self._tables[name].ctypes.data, 1, 0)


def _linked(plan: Plan) -> dict[str, Any]:
    """Each function once, by the name of its entry."""
    import llvmlite.binding as llvm

    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    target = llvm.Target.from_default_triple().create_target_machine(reloc="pic", codemodel="small")
    jit = llvm.create_lljit_compiler(target, use_jit_link=True)
    signature = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_int64, ctypes.c_int64)
    found: dict[str, Any] = {}
    for code in plan.routines.values():
        if code.entry in found:
            continue
        builder = llvm.JITLibraryBuilder().add_object_img(code.object).add_current_process()
        library = builder.export_symbol(code.entry).link(jit, f"of_{code.entry}")
        function: Any = signature(library[code.entry])
        # The code lives as long as what holds it.
        function.held = (jit, library)
        found[code.entry] = function
    return found
