"""Memory shared by the processes of a real-time loop: mailboxes and ring buffers; machine code with its data.

An arena is one block of memory with the inputs and outputs of machine code, and the code itself.
"""

from __future__ import annotations

import ctypes
import mmap
import os
import sys
import tempfile
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

NEWEST = 8
"""Number of messages that a mailbox stores, so that the newest can be read while the next is written."""


def create_shared_memory(size: int) -> int:
    """Return the file descriptor of new shared memory, which is freed when the last process that uses it ends.

    - `size`: size of the memory [bytes].
    """
    if sys.platform == "linux":
        descriptor = os.memfd_create("slidax")
    else:
        with tempfile.TemporaryFile() as file:
            descriptor = os.dup(file.fileno())
    os.ftruncate(descriptor, size)
    os.set_inheritable(descriptor, True)
    return descriptor


def map_shared_memory(descriptor: int) -> np.ndarray:
    """Map shared memory into this process; return it as an array of bytes.

    - `descriptor`: file descriptor from `create_shared_memory`.
    """
    return np.frombuffer(mmap.mmap(descriptor, 0), np.uint8)


FRESH = 16
"""Number of newest rows that a reader does not read yet: its CPU core may see the row count before the rows."""


class Mailbox:
    """Mailbox with the newest message from one process to another: bytes of fixed size, with a number and a checksum.

    The checksum detects an incomplete message, since writes can become visible to other CPU cores in any order.
    `message` is the buffer that `put` sends and `get` fills.

    - `memory`: shared memory of `Mailbox.size(length)` bytes.
    - `length`: length of a message [bytes], a multiple of 8.
    """

    def __init__(self, memory: np.ndarray, length: int) -> None:
        self._newest = memory[:8].view(np.int64)
        self._rows = memory[8 : self.size(length)].reshape(NEWEST, length + 16)
        self._numbers = [row[:8].view(np.int64) for row in self._rows]
        self._bodies = [row[8:-8] for row in self._rows]
        self._sums = [row[-8:].view(np.uint64) for row in self._rows]
        self.message = np.zeros(length, np.uint8)

    @staticmethod
    def size(length: int) -> int:
        """Bytes of shared memory for messages of this length."""
        return 8 + NEWEST * (length + 16)

    def clear(self) -> None:
        """Remove all messages."""
        self._newest[0] = -2

    def put(self, number: int) -> None:
        """Publish `message` as the newest; its `number` must be larger than that of the previous one."""
        slot = number % NEWEST
        self._numbers[slot][0] = number
        self._bodies[slot][:] = self.message
        self._sums[slot][0] = zlib.crc32(self.message, number & 0xFFFFFFFF)
        self._newest[0] = number

    def get(self) -> int:
        """Copy the newest message into `message`; return its number.

        Returns -2 if there is no message or it is incomplete; the content of `message` is then undefined.
        """
        number = int(self._newest[0])
        if number == -2:
            return -2
        slot = number % NEWEST
        self.message[:] = self._bodies[slot]
        intact = int(self._sums[slot][0]) == zlib.crc32(self.message, number & 0xFFFFFFFF)
        return number if intact and int(self._numbers[slot][0]) == number else -2


class Ring:
    """Ring buffer of log rows from one process to another; the writer never waits, and overwrites unread rows.

    - `memory`: shared memory of `Ring.size(length, rows)` bytes.
    - `length`: length of a row [bytes], a multiple of 8.
    - `rows`: capacity [rows].
    """

    def __init__(self, memory: np.ndarray, length: int, rows: int) -> None:
        self._written = memory[:8].view(np.int64)
        self._rows = memory[8 : self.size(length, rows)].reshape(rows, length)
        self._count = rows
        self._put = 0
        self._taken = 0
        self.lost = 0

    @staticmethod
    def size(length: int, rows: int) -> int:
        """Bytes of shared memory for a ring of `rows` rows of `length` bytes."""
        return 8 + length * rows

    def put(self, row: np.ndarray) -> None:
        """Write a row."""
        self._rows[self._put % self._count] = row
        self._put += 1
        self._written[0] = self._put

    def take(self, *, last: bool = False) -> np.ndarray:
        """Return the rows written since the last call, as bytes [rows length].

        Rows that the writer has overwritten, or will overwrite soon, are skipped and counted in `lost`.

        - `last`: True if the writer has ended. False leaves the `FRESH` newest rows for the next call.
        """
        written = int(self._written[0])
        upto = written if last else written - FRESH
        # Keep a distance from the row that is being written.
        oldest = written - self._count + 4 * FRESH
        if self._taken < oldest:
            self.lost += oldest - self._taken
            self._taken = oldest
        indices = np.arange(self._taken, max(upto, self._taken)) % self._count
        self._taken = max(upto, self._taken)
        return self._rows[indices]


ALIGNED = 64
"""Alignment of an arena's block [bytes]: a cache line, which is enough for every vector load."""


@dataclass(frozen=True)
class Slot:
    """Position of an array in an arena's block of memory; `offset` is its start [bytes]."""

    offset: int
    shape: tuple[int, ...]
    dtype: str

    @property
    def end(self) -> int:
        """End of the array in the block [bytes]."""
        return self.offset + int(np.prod(self.shape, dtype=int)) * np.dtype(self.dtype).itemsize


@dataclass(frozen=True)
class MachineCode:
    """Machine code of one routine, with the positions of its inputs and outputs in memory.

    - `object`: an object file for this machine.
    - `entry`: name of its function.
    - `offsets`: offsets of all inputs and then all outputs in the arena's block [bytes]; no output overlaps an input.
    """

    object: bytes
    entry: str
    offsets: tuple[int, ...]


@dataclass(frozen=True)
class CodePlan:
    """Description of an `Arena`, which can be pickled and sent to another process.

    - `initial`: content of the block of memory before the first call.
    - `routines`: machine code by name.
    - `views`: position of each named array in the block.
    - `regions`: start and end of parts of the block [bytes], by name; a part can contain several arrays.
    """

    initial: bytes
    routines: dict[str, MachineCode]
    views: dict[str, Slot]
    regions: dict[str, tuple[int, int]]


class Arena:
    """A block of memory with all inputs and outputs of machine code, and its routines ready to call.

    The overhead of a call is less than 1 µs.

    Raises ImportError if llvmlite is missing.
    """

    def __init__(self, plan: CodePlan) -> None:
        self.plan = plan
        memory = np.zeros(len(plan.initial) + ALIGNED, np.uint8)
        start = -memory.ctypes.data % ALIGNED
        self.block = memory[start : start + len(plan.initial)]
        self.reset()
        self._address = self.block.ctypes.data
        self._linked = _link(plan)
        self._tables = {
            name: np.array([self._address + offset for offset in code.offsets], np.uintp)
            for name, code in plan.routines.items()
        }

    def reset(self) -> None:
        """Restore the initial content of the block."""
        self.block[:] = np.frombuffer(self.plan.initial, np.uint8)

    def view(self, name: str) -> np.ndarray:
        """Return a named array, which shares the memory of the block."""
        slot = self.plan.views[name]
        return self.block[slot.offset : slot.end].view(slot.dtype).reshape(slot.shape)

    def region(self, name: str) -> np.ndarray:
        """Return a named part of the block as bytes, which share its memory."""
        start, end = self.plan.regions[name]
        return self.block[start:end]

    def routine(self, name: str) -> Callable[[], None]:
        """Return a routine as a function without arguments; it reads its inputs and writes its outputs in the block."""
        code = self.plan.routines[name]
        return partial(self._linked[code.entry], self._tables[name].ctypes.data, 1, 0)


def _link(plan: CodePlan) -> dict[str, Any]:
    """Link each function of a plan once, and return the functions by name."""
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
        # These references keep the code alive.
        function.held = (jit, library)
        functions[code.entry] = function
    return functions
