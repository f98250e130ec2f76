"""What a loop in real time has shown: times, what was missed, and whether the envelope was kept."""

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
"""What is measured, by what it is called: columns of the law and of the arm, s."""

SHARES = {"p50": 50.0, "p99": 99.0, "p99.9": 99.9, "max": 100.0}


@dataclass(frozen=True)
class Looped:
    """A loop that has ended.

    - `period`: between two ticks [s].
    - `ticks`: of the arm.
    - `answers`: of the law.
    - `times`: by what they are of, s.
    - `law`, `arm`: what the sides said; None for one that was killed.
    - `outside`: ticks at which a joint was at or outside its envelope before the arm braked; None without an envelope.
    - `margin`: least distance to the envelope as a share of its width, for each joint.
    - `statuses`: how many answers had each bit.
    - `recorder`: processor time of the recorder a tick [s].
    - `size`: of the log [bytes]; None without one.
    - `lost`: rows that the recorder was too slow for.
    - `hogs`: processes beside it.
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
        """Why it ended."""
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
        """Whether it reached its end inside its envelope."""
        return self.reason in ("done", "stopped") and not self.outside

    @property
    def held(self) -> int:
        """Ticks at which no command had come in time, and the last torque stood."""
        return 0 if self.arm is None else self.arm.counts["held"]

    def percentiles(self) -> dict[str, dict[str, float]]:
        """Of each time [s]."""
        found = {}
        for name, values in self.times.items():
            if len(values):
                found[name] = {share: float(np.percentile(values, at)) for share, at in SHARES.items()}
        return found

    def not_granted(self) -> list[str]:
        """What the system did not allow, and what to do about it."""
        sides = [side for side in (self.law, self.arm) if side is not None]
        said = []
        if any(side.priority is None for side in sides):
            said.append(
                "no real-time priority (SCHED_FIFO): other processes come in between; `ulimit -r 99` in a shell that "
                "may, or a line `@realtime - rtprio 99` in /etc/security/limits.conf"
            )
        if any(not side.locked for side in sides):
            said.append(
                "memory is not locked (mlockall): a page may have to be fetched; `ulimit -l unlimited`, or a line "
                "`@realtime - memlock unlimited` there"
            )
        if any(not side.absolute for side in sides):
            said.append("no absolute wake-ups (clock_nanosleep) on this system: only Linux has what a loop needs")
        return said

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
    """What is kept of the rows for the end.

    - `law`, `arm`: their plans.
    - `period`: between two ticks [s].
    - `spent`: processor time on them [s].
    """

    law: LawPlan
    arm: ArmPlan
    period: float
    spent: float = 0.0
    _kept: dict[str, list[np.ndarray]] = field(default_factory=dict)

    def add(self, law: np.ndarray, arm: np.ndarray) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
        """Keeps what the end needs; returns the columns of both.

        - `law`, `arm`: rows as bytes.
        """
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
        """The end.

        - `law`, `arm`: what the sides said.
        - `lost`, `size`, `hogs`: as in `Looped`.
        """
        whole = {name: np.concatenate(parts) for name, parts in self._kept.items()}
        outside, margin = self._judged(whole)
        bits = self.law.channels.bits
        ticks = len(whole["true_k"])
        return Looped(
            period=self.period,
            ticks=ticks,
            answers=len(whole["k"]),
            # The first row has the time of none before it.
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
        """By the true error at every tick; where the law gave no answer, the bounds lie between its next ones."""
        if not self.law.channels.bounded or not len(whole["k"]):
            return None, None
        moving = whole["braking"] == 0
        at, e = whole["true_k"][moving], whole["true_e"][moving]
        lower, upper = (
            np.stack([np.interp(at, whole["k"], one) for one in whole[name].T], axis=1) for name in ("lower", "upper")
        )
        margin = np.minimum(e - lower, upper - e) / (upper - lower)
        return int((margin <= 0).any(axis=1).sum()), margin.min(axis=0).tolist()
