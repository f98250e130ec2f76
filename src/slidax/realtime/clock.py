"""The monotonic clock of a loop, and the real-time scheduling that a process requests from the system."""

from __future__ import annotations

import ctypes
import gc
import os
import sys
import time
from dataclasses import dataclass

SECOND = 1_000_000_000
"""In ns."""

_ABSOLUTE, _MONOTONIC = 1, 1
_TIMER_SLACK, _DEATH_SIGNAL, _KILL = 29, 1, 9
_ALL_MEMORY = 3
"""MCL_CURRENT and MCL_FUTURE, as Linux has them."""


class _Timespec(ctypes.Structure):
    _fields_ = (("seconds", ctypes.c_long), ("nanoseconds", ctypes.c_long))


def now() -> int:
    """Time of the monotonic clock [ns], which all processes of a machine share."""
    if sys.platform == "win32":
        return time.monotonic_ns()
    return time.clock_gettime_ns(time.CLOCK_MONOTONIC)


class Sleeper:
    """Sleeps until an absolute time, so that one delay does not shift all later wake-ups."""

    def __init__(self) -> None:
        self._time = _Timespec()
        self._reference = ctypes.byref(self._time)
        self._sleep = None
        if sys.platform == "linux":
            self._sleep = ctypes.CDLL(None).clock_nanosleep

    def until(self, when: int) -> None:
        """Return at time `when` [ns, by `now`], or at once if it has passed."""
        if self._sleep is None:
            left = when - now()
            if left > 0:
                time.sleep(left / SECOND)
            return
        self._time.seconds, self._time.nanoseconds = divmod(when, SECOND)
        while self._sleep(_MONOTONIC, _ABSOLUTE, self._reference, None):
            pass  # a signal woke it


@dataclass(frozen=True)
class Granted:
    """The real-time properties that the system granted.

    - `priority`: real-time priority (SCHED_FIFO); None for an ordinary process.
    - `locked`: True if its memory stays in RAM (mlockall).
    - `absolute`: True if it sleeps by absolute times (clock_nanosleep).
    """

    priority: int | None
    locked: bool
    absolute: bool


def settle(priority: int) -> Granted:
    """Request real-time priority (1 to 99) and locked memory, stop garbage collection, and return what was granted.

    The process ends when its parent does.
    """
    gc.collect()
    gc.freeze()
    gc.disable()
    if sys.platform != "linux":
        return Granted(None, False, False)
    system = ctypes.CDLL(None, use_errno=True)
    system.prctl(_DEATH_SIGNAL, _KILL, 0, 0, 0)
    # Without this, a timer without real-time priority may be 50 µs late, to save power.
    system.prctl(_TIMER_SLACK, 1, 0, 0, 0)
    locked = system.mlockall(_ALL_MEMORY) == 0
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
    except OSError:
        return Granted(None, locked, True)
    return Granted(priority, locked, True)
