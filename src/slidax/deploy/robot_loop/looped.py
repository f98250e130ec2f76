"""Result of a loop in real time: timing, missed ticks, and the envelope."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from slidax.realtime import Report

from .arm_plan import ArmPlan
from .law_plan import LawPlan

TIMES = {
    "wake-up, law": "wake",
    "wake-up, arm": "true_wake",
    "step": "took",
    "measurement to command": "response",
    "row into the ring": "logged",
}
"""Measured times [s] by their titles: columns of the law and of the arm."""

SHARES = {"p50": 50.0, "p99": 99.0, "p99.9": 99.9, "max": 100.0}


@dataclass(frozen=True)
class Looped:
    """Result of a loop.

    - `period`: between two ticks [s].
    - `ticks`, `answers`: of the arm, and of the law.
    - `times`: measured times [s], by title.
    - `law`, `arm`: the sides' reports; None for a side that was killed.
    - `outside`: ticks at which a joint was at or outside its envelope before the arm braked; None without an envelope.
    - `margin`: smallest distance to the envelope as a share of its width, for each joint.
    - `statuses`: number of answers with each bit.
    - `recorder`: processor time of the recorder per tick [s].
    - `size`: of the log [bytes]; None without one.
    - `lost`: rows lost by the recorder.
    - `hogs`: additional processes.
    """

    period: float
    ticks: int
    answers: int
    times: dict[str, np.ndarray]
    law: Report | None
    arm: Report | None
    outside: int | None
    margin: list[float] | None
    statuses: dict[str, int]
    recorder: float
    size: int | None
    lost: int
    hogs: int

    @property
    def reason(self) -> str:
        """Why the loop ended."""
        if self.law is None:
            return "the law's process was killed, and the arm braked"
        if self.arm is None:
            return "the arm's process was killed"
        if self.arm.reason == "no command":
            return "the arm braked, as no command had come for too long"
        if self.arm.reason == "stop requested":
            return "the arm braked, as the law asked for a stop (STOP_REQUESTED): too many commands in a row were held"
        return {"done": "done", "stopped": "stopped", "not finite": "the arm's motion became infinite"}[self.arm.reason]

    @property
    def good(self) -> bool:
        """True if it reached its end inside its envelope."""
        return self.reason in ("done", "stopped") and not self.outside

    @property
    def held(self) -> int:
        """Ticks at which no command arrived in time and the last torque was held."""
        return 0 if self.arm is None else self.arm.counts["held"]

    def percentiles(self) -> dict[str, dict[str, float]]:
        """Percentiles of each time [s]."""
        table = {}
        for name, values in self.times.items():
            if len(values):
                table[name] = {share: float(np.percentile(values, at)) for share, at in SHARES.items()}
        return table

    def not_granted(self) -> list[str]:
        """Real-time properties that the system refused, with remedies."""
        sides = [side for side in (self.law, self.arm) if side is not None]
        refusals = []
        if any(side.priority is None for side in sides):
            refusals.append(
                "no real-time priority (SCHED_FIFO), so other processes interfere: run `ulimit -r 99` in a privileged "
                "shell, or add a line `@realtime - rtprio 99` to /etc/security/limits.conf"
            )
        if any(not side.locked for side in sides):
            refusals.append(
                "memory is not locked (mlockall), so page faults can occur: run `ulimit -l unlimited`, or add a line "
                "`@realtime - memlock unlimited` there"
            )
        if any(not side.absolute for side in sides):
            refusals.append("no absolute wake-ups (clock_nanosleep): only Linux has them")
        return refusals

    def as_json(self) -> dict[str, Any]:
        """For programs; times in us."""
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
                else {"fifo": report.priority, "locked": report.locked, "absolute": report.absolute}
                for name, report in sides.items()
            },
            "hogs": self.hogs,
        }


@dataclass
class Recorded:
    """Recorder of a loop's rows.

    - `period`: between two ticks [s].
    - `spent`: processor time used [s].
    """

    law: LawPlan
    arm: ArmPlan
    period: float
    spent: float = 0.0
    _kept: dict[str, list[np.ndarray]] = field(default_factory=dict)

    def add(self, law: np.ndarray, arm: np.ndarray) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
        """Record rows (bytes); return the columns of both sides."""
        of_law, of_arm = self.law.columns(law), self.arm.columns(arm)
        bounds = ("lower", "upper") if self.law.channels.bounded else ()
        for columns, names in (
            (of_law, ("k", "status", "wake", "took", "response", "logged", *bounds)),
            (of_arm, ("true_k", "true_e", "true_wake", "braking")),
        ):
            for name in names:
                self._kept.setdefault(name, []).append(columns[name].copy())
        return of_law, of_arm

    def looped(self, law: Report | None, arm: Report | None, lost: int, size: int | None, hogs: int) -> Looped:
        """Return the result; the arguments are those of `Looped`."""
        whole = {name: np.concatenate(parts) for name, parts in self._kept.items()}
        outside, margin = self._judged(whole)
        bits = self.law.channels.bits
        ticks = len(whole["true_k"])
        return Looped(
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
        """Ticks outside the envelope, and margins, by the true error.

        The bounds are interpolated where the law gave no answer.
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
