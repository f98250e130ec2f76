"""What both processes of a loop do around their work."""

from __future__ import annotations

import pickle
import sys
import time
from collections.abc import Callable

import numpy as np

from .board import mapped
from .clock import Granted, settle
from .job import Job, Report

READY = b"ready\n"


class Stage:
    """What a process shares with the others.

    - `memory`: all of it.
    - `job`: its own.
    """

    def __init__(self, memory: np.ndarray, job: Job) -> None:
        self._memory, self._job = memory, job
        self._begins = memory[job.places.start :][:16].view(np.int64)
        self._granted = Granted(None, False, False)

    def at(self, offset: int) -> np.ndarray:
        """The memory from there on.

        - `offset`: in bytes.
        """
        return self._memory[offset:]

    def ready(self) -> None:
        """Asks the system for what keeps a process in time, and says that the work may begin."""
        self._granted = settle(self._job.priority)
        sys.stdout.buffer.write(READY)
        sys.stdout.buffer.flush()

    def started(self) -> int:
        """Waits until the time of tick 0 is known; returns it [ns]."""
        while not self._begins[0]:
            time.sleep(1e-3)
        return int(self._begins[0])

    @property
    def stops(self) -> bool:
        """Whether all is to end."""
        return bool(self._begins[1])

    def report(self, reason: str, counts: dict[str, int]) -> Report:
        """What is said at the end.

        - `reason`, `counts`: as in `Report`.
        """
        granted = self._granted
        return Report(reason, granted.priority, granted.locked, granted.absolute, counts)


def took_part(work: Callable[[Job, Stage], Report]) -> None:
    """A whole process: takes its job from standard input, and leaves its report on standard output.

    - `work`: what it does.
    """
    job: Job = pickle.load(sys.stdin.buffer)
    report = work(job, Stage(mapped(int(sys.argv[1])), job))
    sys.stdout.buffer.write(pickle.dumps(report))
    sys.stdout.buffer.flush()
