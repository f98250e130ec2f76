"""The sampled loop in real time: law and simulated arm in separate processes, timing statistics, and a log.

A tick is an instant at which the arm can apply a new torque; two ticks are one sample time apart. If no torque arrives
in time, the arm holds the last one; after several such ticks it brakes.
"""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager, suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

import numpy as np

from slidax.core.errors import DefinitionError
from slidax.runtime.logs.mcap_files import LogWriter
from slidax.runtime.processes import run_law
from slidax.runtime.shared_memory import Mailbox, Ring, create_shared_memory, map_shared_memory
from slidax.runtime.sides import KEPT_ROWS, LoopJob, MemoryLayout, SideReport, now

from .lockstep import attachments_of, metadata_of
from .loop_plans import ArmPlan, LawPlan, arm_plan, law_plan
from .status import STOP_REQUESTED

TIMES = {
    "wake-up, law": "wake",
    "wake-up, arm": "true_wake",
    "step": "took",
    "measurement to command": "response",
    "row into the ring": "logged",
}
"""Columns of law and arm with measured times [s], by their titles."""

SHARES = {"p50": 50.0, "p99": 99.0, "p99.9": 99.9, "max": 100.0}


@dataclass(frozen=True)
class LoopResult:
    """Result of a real-time loop.

    - `period`: time between two ticks [s].
    - `ticks`: number of ticks of the arm.
    - `answers`: number of samples at which the law computed a torque.
    - `times`: measured durations and latencies [s], one per sample or tick, by title.
    - `law`, `arm`: reports of the two processes; None for a process that was killed.
    - `outside`: number of ticks, until the arm braked, at which a joint was at or outside its envelope; None without an
      envelope.
    - `margin`: smallest distance from the envelope's bounds as a share of its width, for each joint; None without one.
    - `statuses`: for each status bit, by name, the number of samples at which the law set it.
    - `recorder`: CPU time of the recorder per tick [s].
    - `size`: size of the log [bytes]; None without a log.
    - `lost`: number of log rows that the recorder missed.
    - `hogs`: number of additional processes that only used CPU time, as a stress test.
    """

    period: float
    ticks: int
    answers: int
    times: dict[str, np.ndarray]
    law: SideReport | None
    arm: SideReport | None
    outside: int | None
    margin: list[float] | None
    statuses: dict[str, int]
    recorder: float
    size: int | None
    lost: int
    hogs: int

    @property
    def reason(self) -> str:
        """Reason for which the loop ended; "done" or "stopped" if no fault ended it."""
        if self.law is None:
            return "the law's process was killed, and the arm braked"
        if self.arm is None:
            return "the arm's process was killed"
        return {
            "no command": "the arm braked, as no command had come for too long",
            "stop requested": "the arm braked, as the law asked for a stop (STOP_REQUESTED): "
            "too many commands in a row were held",
            "not finite": "the arm's motion became infinite",
        }.get(self.arm.reason, self.arm.reason)

    @property
    def good(self) -> bool:
        """True if the loop ended without a fault and no joint left its envelope."""
        return self.reason in ("done", "stopped") and not self.outside

    @property
    def held(self) -> int:
        """Number of ticks at which no command arrived in time, so that the arm held the last torque."""
        return 0 if self.arm is None else self.arm.counts["held"]

    def percentiles(self) -> dict[str, dict[str, float]]:
        """Return the percentiles of each measured time [s], by title and percentile."""
        return {
            name: {share: float(np.percentile(values, at)) for share, at in SHARES.items()}
            for name, values in self.times.items()
            if len(values)
        }

    def not_granted(self) -> list[str]:
        """Return sentences about the real-time properties that the system refused, with remedies."""
        granted = [side.granted for side in (self.law, self.arm) if side is not None]
        refusals = []
        if any(each.priority is None for each in granted):
            refusals.append(
                "no real-time priority (SCHED_FIFO), so other processes interfere: run `ulimit -r 99` in a privileged "
                "shell, or add a line `@realtime - rtprio 99` to /etc/security/limits.conf"
            )
        if any(not each.locked for each in granted):
            refusals.append(
                "memory is not locked (mlockall), so page faults can occur: run `ulimit -l unlimited`, or add a line "
                "`@realtime - memlock unlimited` to /etc/security/limits.conf"
            )
        if any(not each.absolute for each in granted):
            refusals.append("no absolute wake-ups (clock_nanosleep): only Linux has them")
        return refusals

    def as_json(self) -> dict[str, Any]:
        """Return the result as JSON data; latencies in µs."""
        arm = {} if self.arm is None else self.arm.counts
        sides = {"law": self.law, "arm": self.arm}
        return {
            "period": self.period,
            "ticks": self.ticks,
            "answers": self.answers,
            "ended": self.reason,
            "missed": {
                "ticks": self.held,
                "longest": arm.get("longest", 0),
                "caught_up": arm.get("caught_up", 0),
                "rolled_back": 0 if self.law is None else self.law.counts["rolled_back"],
                "skipped": 0 if self.law is None else self.law.counts["skipped"],
            },
            "latency_us": {
                name: {share: round(1e6 * value, 2) for share, value in shares.items()}
                for name, shares in self.percentiles().items()
            },
            "envelope": {"outside": self.outside, "margin": self.margin},
            "status": self.statuses,
            "log": {"bytes": self.size, "recorder_us": round(1e6 * self.recorder, 2), "rows_lost": self.lost},
            "system": {
                name: None
                if report is None
                else {
                    "fifo": report.granted.priority,
                    "locked": report.granted.locked,
                    "absolute": report.granted.absolute,
                }
                for name, report in sides.items()
            },
            "hogs": self.hogs,
        }


@dataclass
class LoopRecorder:
    """Recorder of a loop's log rows. A row has the data of one sample of the law, or of one tick of the arm.

    - `law`, `arm`: plans of the two processes, with the layouts of their rows.
    - `period`: time between two ticks [s].
    - `spent`: CPU time that recording has used [s].
    """

    law: LawPlan
    arm: ArmPlan
    period: float
    spent: float = 0.0
    _kept: dict[str, list[np.ndarray]] = field(default_factory=dict)

    def add(self, law: np.ndarray, arm: np.ndarray) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
        """Record rows of law and arm (arrays of bytes), and return the columns of both by name."""
        of_law, of_arm = self.law.columns(law), self.arm.columns(arm)
        bounds = ("lower", "upper") if self.law.channels.bounded else ()
        for columns, names in (
            (of_law, ("k", "status", "wake", "took", "response", "logged", *bounds)),
            (of_arm, ("true_k", "true_e", "true_wake", "braking")),
        ):
            for name in names:
                self._kept.setdefault(name, []).append(columns[name].copy())
        return of_law, of_arm

    def result(
        self, law: SideReport | None, arm: SideReport | None, lost: int, size: int | None, hogs: int
    ) -> LoopResult:
        """Return the result of all recorded rows; the arguments are fields of `LoopResult`."""
        whole = {name: np.concatenate(parts) for name, parts in self._kept.items()}
        outside, margin = self._judged(whole)
        bits = self.law.channels.bits
        ticks = len(whole["true_k"])
        return LoopResult(
            period=self.period,
            ticks=ticks,
            answers=len(whole["k"]),
            # The first row has no logging time before it.
            times={name: whole[column][1:] if column == "logged" else whole[column] for name, column in TIMES.items()},
            law=law,
            arm=arm,
            outside=outside,
            margin=margin,
            statuses={name: int(((whole["status"] >> place) & 1).sum()) for place, name in enumerate(bits)},
            recorder=self.spent / max(ticks, 1),
            size=size,
            lost=lost,
            hogs=hogs,
        )

    def _judged(self, whole: dict[str, np.ndarray]) -> tuple[int | None, list[float] | None]:
        """Return the number of ticks outside the envelope and the smallest margin of each joint, from the true error.

        Both are None without an envelope. Its bounds are interpolated at ticks for which the law computed no torque.
        """
        if not self.law.channels.bounded or not len(whole["k"]):
            return None, None
        moving = whole["braking"] == 0
        at, e = whole["true_k"][moving], whole["true_e"][moving]
        lower, upper = (
            np.stack([np.interp(at, whole["k"], bound) for bound in whole[name].T], axis=1)
            for name in ("lower", "upper")
        )
        margin = np.minimum(e - lower, upper - e) / (upper - lower)
        return int((margin <= 0).any(axis=1).sum()), margin.min(axis=0).tolist()


if TYPE_CHECKING:
    from slidax.scenarios.scenario import Scenario

CHUNK, LOOK = 0.5, 0.05
"""Interval at which the recorder reads the rings and writes a chunk, and its reading interval with live data [s]."""

PHASE = 0.1
"""Time from a tick to the law's wake-up, relative to the period; the measurement has usually arrived by then."""

LEAD = 100_000_000
"""Time from the start signal to tick 0 [ns]."""

LAW_FIRST, ARM_FIRST = 80, 81
"""Real-time priorities of law and arm. The arm's is higher, since a robot's own computer does not wait for the law."""


def run_loop(
    scenario: Scenario,
    *,
    log: Path | None = None,
    port: int | None = None,
    patience: int = 20,
    hogs: int = 0,
) -> LoopResult:
    """Run a scenario in real time from its start to its `t1`, or until the process of the law or the arm ends.

    - `scenario`: scenario in held mode (one torque per sample), with measurements at least one period old.
    - `log`: MCAP file for the log; None for no log.
    - `port`: port of a local Foxglove server; None for no server.
    - `patience`: ticks without a command until the arm brakes, and without a measurement until the law ends.
    - `hogs`: number of additional processes that only use CPU time, as a stress test.

    Raises DefinitionError if the scenario cannot run in real time or a package is missing, OSError if the log cannot be
    written.
    """
    if os.name != "posix":
        raise DefinitionError("a real-time loop needs a POSIX system such as Linux; use `slidax run` elsewhere")
    if log is not None and log.suffix != ".mcap":
        raise DefinitionError(f"the log of a loop must end in .mcap; got `{log.name}`")
    # The arm comes first, since it is more likely to be rejected than the law.
    of_arm, of_law = arm_plan(scenario, transport=1), law_plan(scenario)
    ticks = round(scenario.t1 / scenario.period)
    lengths = _lengths(of_law, of_arm)
    places = _places(lengths)
    descriptor = create_shared_memory(places.size)
    memory = map_shared_memory(descriptor)
    job = LoopJob(
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
    recorded = LoopRecorder(of_law, of_arm, scenario.period)
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
    return recorded.result(reports[1], reports[0], sum(ring.lost for ring in rings), size, hogs)


def _record(
    sides: list[subprocess.Popen[bytes]],
    rings: tuple[Ring, Ring],
    recorded: LoopRecorder,
    writer: LogWriter | None,
    pause: float,
) -> None:
    """Read rows of law and arm, and write them to the log, until both processes have ended."""
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
    """Return the lengths of a measurement, a command, a row of the law and a row of the arm [bytes]."""
    start, end = law.plan.regions["measured"]
    first, last = law.plan.regions["tau"]
    return 24 + end - start, 8 + last - first, law.row.itemsize, arm.row.itemsize


def _places(lengths: tuple[int, int, int, int]) -> MemoryLayout:
    measurement, command, law_row, arm_row = lengths
    sizes = (
        Mailbox.size(measurement),
        Mailbox.size(command),
        Ring.size(law_row, KEPT_ROWS),
        Ring.size(arm_row, KEPT_ROWS),
        16,
    )
    # Separate pages, so that writes of one process do not slow reads of the other one.
    ends = np.cumsum([-(-size // 4096) * 4096 for size in sizes]).tolist()
    return MemoryLayout(0, *ends)


def _started(name: str, descriptor: int, job: LoopJob) -> AbstractContextManager[subprocess.Popen[bytes]]:
    side = subprocess.Popen(
        [sys.executable, "-m", run_law.__module__, name, str(descriptor)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        pass_fds=[descriptor],
        # Ctrl-C interrupts only this process, which then stops the others.
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
            raise DefinitionError("the process of the law or the arm did not start; see its output above")


def _report(side: subprocess.Popen[bytes]) -> SideReport | None:
    """Return the report of a process; None if the process was killed."""
    report = _output(side).read()
    if side.wait() or not report:
        return None
    return pickle.loads(report)


def _output(side: subprocess.Popen[bytes]) -> IO[bytes]:
    assert side.stdout is not None
    return side.stdout
