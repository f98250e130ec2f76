"""The loop in real time: the law in one process, the arm in another, and a recorder in this one."""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from typing import IO, TYPE_CHECKING

import numpy as np

from slidax._errors import DefinitionError
from slidax.logs import LogWriter
from slidax.realtime import KEPT_ROWS, Job, Mailbox, Places, Report, Ring, anonymous, mapped, now
from slidax.realtime.law_process import run_law

from ..status import STOP_REQUESTED
from .arm_plan import ArmPlan, arm_plan
from .kept import attachments_of, metadata_of
from .law_plan import LawPlan, law_plan
from .looped import Looped, Recorded

if TYPE_CHECKING:
    from slidax.scenarios import Scenario

CHUNK, LOOK = 0.5, 0.05
"""Interval at which rows are read from the rings and written as a chunk, and the same with live data [s]."""

PHASE = 0.1
"""Wake-up of the law after a tick, as a share of the period; its measurement has usually arrived by then."""

LEAD = 100_000_000
"""From the start signal to tick 0 [ns]."""

LAW_FIRST, ARM_FIRST = 80, 81
"""Real-time priorities; the arm's is higher, as a robot's own computer does not wait for ours."""


def run_loop(
    scenario: Scenario,
    *,
    log: Path | None = None,
    port: int | None = None,
    patience: int = 20,
    hogs: int = 0,
) -> Looped:
    """Run a scenario in real time from its start to its `t1`, or until a side stops.

    - `scenario`: in held mode, with measurements that are at least one period old.
    - `log`: an MCAP file; None for none.
    - `port`: of a local Foxglove server; None for none.
    - `patience`: ticks without a command until the arm brakes, and without a measurement until the law ends.
    - `hogs`: additional processes that only burn time.

    Raises DefinitionError if the scenario does not allow it or a package is missing, OSError if the log cannot be
    written.
    """
    if os.name != "posix":
        raise DefinitionError("a real-time loop needs a POSIX system such as Linux; use `slidax run` elsewhere")
    if log is not None and log.suffix != ".mcap":
        raise DefinitionError(f"the log of a loop must end in .mcap; got `{log.name}`")
    # The arm first, as it is more likely to be refused.
    of_arm, of_law = arm_plan(scenario, transport=1), law_plan(scenario)
    ticks = round(scenario.t1 / scenario.period)
    lengths = _lengths(of_law, of_arm)
    places = _places(lengths)
    descriptor = anonymous(places.size)
    memory = mapped(descriptor)
    job = Job(
        plan=of_law.plan,
        places=places,
        lengths=lengths,
        period=scenario.period,
        ticks=ticks,
        patience=patience,
        phase=round(PHASE * scenario.period * 1e9),
        priority=LAW_FIRST,
        world=None,
        substeps=of_arm.substeps,
        stop_bit=STOP_REQUESTED.bit,
    )
    of_the_arm = replace(job, plan=of_arm.plan, priority=ARM_FIRST, world=of_arm.world)
    begins = memory[places.start :][:16].view(np.int64)
    recorded = Recorded(of_law, of_arm, scenario.period)
    with ExitStack() as stack:
        stack.callback(os.close, descriptor)
        sides = [
            stack.enter_context(_started(name, descriptor, side)) for name, side in (("arm", of_the_arm), ("law", job))
        ]
        _wait_for(sides)
        writer = None
        if log is not None or port is not None:
            metadata = metadata_of(scenario, "loop", scenario.t1)
            start = time.time_ns() + LEAD
            writer = LogWriter(log, of_law.channels, metadata, attachments_of(scenario), start=start, port=port)
            stack.callback(writer.close)
        for _ in range(hogs):
            stack.enter_context(_ended(subprocess.Popen([sys.executable, "-c", "while True: pass"])))
        rings = (
            Ring(memory[places.law_rows :], lengths[2], KEPT_ROWS),
            Ring(memory[places.arm_rows :], lengths[3], KEPT_ROWS),
        )
        pause = CHUNK if port is None else LOOK
        begins[0] = now() + LEAD
        try:
            _record(sides, rings, recorded, writer, pause)
        except KeyboardInterrupt:
            begins[1] = 1
            _record(sides, rings, recorded, writer, pause)
        reports = [_report(side) for side in sides]
    size = log.stat().st_size if log is not None else None
    return recorded.looped(reports[1], reports[0], sum(ring.lost for ring in rings), size, hogs)


def _record(
    sides: list[subprocess.Popen[bytes]],
    rings: tuple[Ring, Ring],
    recorded: Recorded,
    writer: LogWriter | None,
    pause: float,
) -> None:
    """Read rows and write them until both sides have ended."""
    flushed = time.monotonic()
    while True:
        over = all(side.poll() is not None for side in sides)
        began = time.process_time()
        law, arm = recorded.add(*(ring.take(last=over) for ring in rings))
        if writer is not None:
            writer.law(law)
            writer.arm(arm)
            if over or time.monotonic() - flushed > CHUNK - LOOK:
                writer.flush()
                flushed = time.monotonic()
        recorded.spent += time.process_time() - began
        if over:
            return
        time.sleep(pause)


def _lengths(law: LawPlan, arm: ArmPlan) -> tuple[int, int, int, int]:
    """Bytes of a measurement, a command, and a row of each side."""
    start, end = law.plan.regions["measured"]
    first, last = law.plan.regions["tau"]
    return 24 + end - start, 8 + last - first, law.row.itemsize, arm.row.itemsize


def _places(lengths: tuple[int, int, int, int]) -> Places:
    measurement, command, law_row, arm_row = lengths
    sizes = (
        Mailbox.size(measurement),
        Mailbox.size(command),
        Ring.size(law_row, KEPT_ROWS),
        Ring.size(arm_row, KEPT_ROWS),
        16,
    )
    # Separate pages, so that one side's writes do not slow the other's reads.
    ends = np.cumsum([-(-size // 4096) * 4096 for size in sizes]).tolist()
    return Places(0, *ends)


def _started(name: str, descriptor: int, job: Job) -> AbstractContextManager[subprocess.Popen[bytes]]:
    side = subprocess.Popen(
        [sys.executable, "-m", run_law.__module__, name, str(descriptor)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        pass_fds=[descriptor],
        # Ctrl-C goes to this process alone, which stops the others.
        start_new_session=True,
    )
    assert side.stdin is not None
    # A dead process is detected by its missing report.
    with suppress(BrokenPipeError), side.stdin as pipe:
        pickle.dump(job, pipe)
    side.stdin = None
    return _ended(side)


@contextmanager
def _ended(process: subprocess.Popen[bytes]) -> Iterator[subprocess.Popen[bytes]]:
    """Yield the process and kill it at the end of the block."""
    try:
        yield process
    finally:
        process.kill()
        process.wait()
        if process.stdout is not None:
            process.stdout.close()


def _wait_for(sides: list[subprocess.Popen[bytes]]) -> None:
    for side in sides:
        output = _output(side)
        if output.readline() != b"ready\n":
            raise DefinitionError("a side of the loop did not start; see its output above")


def _report(side: subprocess.Popen[bytes]) -> Report | None:
    """A side's report; None if it was killed."""
    report = _output(side).read()
    if side.wait() or not report:
        return None
    return pickle.loads(report)


def _output(side: subprocess.Popen[bytes]) -> IO[bytes]:
    assert side.stdout is not None
    return side.stdout
