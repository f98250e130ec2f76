"""Shared memory between processes: anonymous blocks, the newest message of a sender, and rings of rows."""

from __future__ import annotations

import mmap
import os
import sys
import tempfile
import zlib

import numpy as np

NEWEST = 8
"""Messages kept, so that the newest can be read while the next is written."""


def anonymous(size: int) -> int:
    """Return the descriptor of shared memory that vanishes with the last process that holds it; `size` in bytes."""
    if sys.platform == "linux":
        descriptor = os.memfd_create("slidax")
    else:
        with tempfile.TemporaryFile() as file:
            descriptor = os.dup(file.fileno())
    os.ftruncate(descriptor, size)
    os.set_inheritable(descriptor, True)
    return descriptor


def mapped(descriptor: int) -> np.ndarray:
    """Return the shared memory of a descriptor from `anonymous`, as bytes."""
    return np.frombuffer(mmap.mmap(descriptor, 0), np.uint8)


FRESH = 16
"""Rows: a processor may show the count of rows before the newest rows themselves, but never this many periods
before.
"""


class Mailbox:
    """The newest message of one process for another: bytes of one size, with a number and a checksum.

    The checksum detects an incomplete message, in whatever order a processor shows its writes to others.

    - `memory`: shared, `Mailbox.size(length)` bytes.
    - `length`: of a message [bytes], a multiple of 8.
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
        at = number % NEWEST
        self._numbers[at][0] = number
        self._bodies[at][:] = self.message
        self._sums[at][0] = zlib.crc32(self.message, number & 0xFFFFFFFF)
        self._newest[0] = number

    def get(self) -> int:
        """Copy the newest complete message into `message`; return its number.

        Returns -2 if there is none; `message` may then hold anything.
        """
        number = int(self._newest[0])
        if number == -2:
            return -2
        at = number % NEWEST
        self.message[:] = self._bodies[at]
        whole = int(self._sums[at][0]) == zlib.crc32(self.message, number & 0xFFFFFFFF)
        return number if whole and int(self._numbers[at][0]) == number else -2


class Ring:
    """Rows from one process for another that reads them later: the writer never waits, and unread rows are overwritten.

    - `memory`: shared, `Ring.size(length, rows)` bytes.
    - `length`: of a row [bytes], a multiple of 8.
    - `rows`: capacity.
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
        """Bytes of shared memory."""
        return 8 + length * rows

    def put(self, row: np.ndarray) -> None:
        """Write a row."""
        self._rows[self._put % self._count] = row
        self._put += 1
        self._written[0] = self._put

    def take(self, *, last: bool = False) -> np.ndarray:
        """Return the new rows, [m length].

        The newest few wait for the next call, unless the writer has ended (`last`).
        """
        written = int(self._written[0])
        upto = written if last else written - FRESH
        # Margin to the row that is being written.
        oldest = written - self._count + 4 * FRESH
        if self._taken < oldest:
            self.lost += oldest - self._taken
            self._taken = oldest
        which = np.arange(self._taken, max(upto, self._taken)) % self._count
        self._taken = max(upto, self._taken)
        return self._rows[which]
