"""Start and end of a loop's processes."""

from __future__ import annotations

import pickle
import sys
import time
from collections.abc import Callable, Mapping

import numpy as np

from .board import mapped
from .clock import Granted, settle
from .job import Job, Report

READY = b"ready\n"


class Stage:
    """A process's view of the shared memory and of its job."""

    def __init__(self, memory: np.ndarray, job: Job) -> None:
        self._memory, self._job = memory, job
        self._begins = memory[job.places.start :][:16].view(np.int64)
        self._granted = Granted(None, False, False)

    def at(self, offset: int) -> np.ndarray:
        """Return the memory from `offset` [bytes] on."""
        return self._memory[offset:]

    def ready(self) -> None:
        """Request real-time scheduling, and report that the work may begin."""
        self._granted = settle(self._job.priority)
        sys.stdout.buffer.write(READY)
        sys.stdout.buffer.flush()

    def started(self) -> int:
        """Wait until the time of tick 0 is set; return it [ns]."""
        while not self._begins[0]:
            time.sleep(1e-3)
        return int(self._begins[0])

    @property
    def stops(self) -> bool:
        """True if all processes must end."""
        return bool(self._begins[1])

    def report(self, reason: str, counts: dict[str, int]) -> Report:
        """Return the report with the real-time properties that were granted."""
        granted = self._granted
        return Report(reason, granted.priority, granted.locked, granted.absolute, counts)


def run_process(sides: Mapping[str, Callable[[Job, Stage], Report]]) -> None:
    """Run one side: the arguments name it and the shared memory, its job comes by stdin, its report goes to stdout."""
    job: Job = pickle.load(sys.stdin.buffer)
    report = sides[sys.argv[1]](job, Stage(mapped(int(sys.argv[2])), job))
    sys.stdout.buffer.write(pickle.dumps(report))
    sys.stdout.buffer.flush()
