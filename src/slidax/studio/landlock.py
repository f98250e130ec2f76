"""Linux Landlock: a process gives up all files and ports except named ones, for good and for its children.

It also covers operations outside Python: MuJoCo's includes, Arrow's Parquet reader, a compiler.
"""

from __future__ import annotations

import ctypes
import os
import sys
from collections.abc import Iterable
from pathlib import Path

CREATE, ADD, RESTRICT = 444, 445, 446
"""System call numbers, the same on all processors."""

VERSION, BENEATH, NO_NEW_PRIVILEGES = 1, 1, 38

EXECUTE, WRITE, READ_FILE, READ_FOLDER = 1 << 0, 1 << 1, 1 << 2, 1 << 3
LOOK = EXECUTE | READ_FILE | READ_FOLDER
OF_FILES = EXECUTE | WRITE | READ_FILE | 1 << 14
"""Rights of a single file; the last is truncation."""

RIGHTS = {1: 13, 2: 14, 3: 15, 4: 15, 5: 16}
"""Number of rights in each version."""


class _Rules(ctypes.Structure):
    _fields_ = (("files", ctypes.c_uint64), ("ports", ctypes.c_uint64))


class _Beneath(ctypes.Structure):
    _pack_ = 1
    _layout_ = "ms"
    _fields_ = (("allowed", ctypes.c_uint64), ("parent", ctypes.c_int32))


def restrict(read: Iterable[Path], write: Iterable[Path]) -> bool:
    """Give up all files except `read` and `write`, and all TCP connections; return False without Landlock."""
    if sys.platform != "linux":
        return False
    kernel = ctypes.CDLL(None, use_errno=True)
    version = kernel.syscall(CREATE, None, ctypes.c_size_t(0), VERSION)
    if version < 1:
        return False
    all_rights = (1 << RIGHTS[min(version, max(RIGHTS))]) - 1
    # Ports from the fourth version on: to bind and to connect.
    rules = _Rules(all_rights, 3 if version >= 4 else 0)
    size = ctypes.c_size_t(16 if version >= 4 else 8)
    handle = kernel.syscall(CREATE, ctypes.byref(rules), size, 0)
    if handle < 0:
        return False
    try:
        for paths, rights in ((read, LOOK), (write, all_rights)):
            for path in paths:
                _allow(kernel, handle, path, rights & all_rights)
        kernel.prctl(NO_NEW_PRIVILEGES, 1, 0, 0, 0)
        return bool(kernel.syscall(RESTRICT, handle, 0) == 0)
    finally:
        os.close(handle)


def _allow(kernel: ctypes.CDLL, rules: int, path: Path, rights: int) -> None:
    if sys.platform != "linux":
        return
    try:
        place = os.open(path, os.O_PATH | os.O_CLOEXEC)
    except OSError:
        return
    try:
        allowed = rights if path.is_dir() else rights & OF_FILES
        kernel.syscall(ADD, rules, BENEATH, ctypes.byref(_Beneath(allowed, place)), 0)
    finally:
        os.close(place)
