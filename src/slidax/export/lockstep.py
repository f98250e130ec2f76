"""Run a sampled loop sample by sample without waiting for real time, write its log, and replay a log.

A tick is an instant at which the simulated arm can apply a new torque; two ticks are one sample time apart.
"""

from __future__ import annotations

from contextlib import closing
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

import slidax
from slidax.core.errors import DefinitionError, count_noun
from slidax.runtime.logs.mcap_files import SCENARIO, LogWriter, SavedLog
from slidax.runtime.logs.messages import Channels, names_of_bits
from slidax.runtime.sides import ArmSide, LawSide
from slidax.scenarios.load import portable_text, restore

from .loop_plans import arm_plan, law_plan

if TYPE_CHECKING:
    from slidax.scenarios.scenario import Scenario


@dataclass(frozen=True)
class LockstepResult:
    """Result of `lockstep`: the columns of its log.

    - `channels`: joints, signals and status bits in the log.
    - `law`: columns by name; one row for each torque that the law computed.
    - `arm`: columns by name; one row for each tick.
    """

    channels: Channels
    law: dict[str, np.ndarray]
    arm: dict[str, np.ndarray]


def lockstep(scenario: Scenario, samples: int, *, transport: int = 0) -> LockstepResult:
    """Run a scenario's loop sample by sample in the machine code of the real-time loop, but without waiting.

    - `samples`: number of samples.
    - `transport`: periods from a measurement to the torque computed from it, 0 or 1. With 1 the result equals that of
      the real-time loop (two processes) if neither process misses a deadline.

    Raises DefinitionError if the scenario cannot run sample by sample or llvmlite is not installed; NoNativeCodeError
    if an operation of the scenario has no machine code.
    """
    of_law, of_arm = law_plan(scenario), arm_plan(scenario, transport=transport)
    law = LawSide(of_law.plan, scenario.period)
    arm = ArmSide(of_arm.plan, of_arm.world, of_arm.substeps)
    torque = law.tau.view(float)
    answers, ticks = [], []
    applied = -1
    fresh = True
    for k in range(samples):
        if not transport:
            fresh = arm.measure(k)
        if fresh:
            law.measured[:] = arm.measured
            law.answer(k, applied)
            answers.append(law.row.copy())
            arm.tau[:] = torque
            applied = k
        arm.set(k, fresh)
        if transport:
            fresh = arm.measure(k)
        ticks.append(arm.row.copy())
        arm.move()
    return LockstepResult(of_law.channels, of_law.columns(np.stack(answers)), of_arm.columns(np.stack(ticks)))


CHUNK = 500
"""Number of ticks in a chunk of the log, which is compressed as a whole."""


def attachments_of(scenario: Scenario) -> dict[str, bytes]:
    """Return the attachments of a log by file name: the scenario's description, and the files that it refers to.

    Changes made by `Scenario.replace` are missing from the description.
    """
    text, files = portable_text(scenario.description)
    return {SCENARIO: text.encode(), **files}


def metadata_of(scenario: Scenario, made_by: str, seconds: float) -> dict[str, str]:
    """Return the metadata of a log as texts by name: scenario, scheme, robot, sample time and duration.

    - `made_by`: command that writes the log, "run" or "loop".
    - `seconds`: planned duration [s].
    """
    return {
        "slidax": slidax.__version__,
        "scenario": scenario.name,
        "scheme": scenario.scheme,
        "robot": scenario.robot,
        "made_by": made_by,
        "period_s": repr(scenario.period),
        "seconds": repr(seconds),
    }


def write_lockstep_log(scenario: Scenario, stepped: LockstepResult, path: Path) -> None:
    """Write the result of `lockstep` as an MCAP file whose times start at 0.

    Raises DefinitionError if foxglove-sdk is not installed, OSError if the file cannot be written.
    """
    seconds = float(stepped.arm["true_t"][-1])
    metadata, attachments = metadata_of(scenario, "run", seconds), attachments_of(scenario)
    with closing(LogWriter(path, stepped.channels, metadata, attachments)) as writer:
        for first in range(0, len(stepped.arm["true_t"]), CHUNK):
            ticks = stepped.arm["true_k"][first : first + CHUNK]
            answered = (stepped.law["k"] >= ticks[0]) & (stepped.law["k"] <= ticks[-1])
            writer.law({name: column[answered] for name, column in stepped.law.items()})
            writer.arm({name: column[first : first + CHUNK] for name, column in stepped.arm.items()})
            writer.flush()


COMPARED = ("tau", "status")
"""Columns that a replay compares bit by bit with the log."""


@dataclass(frozen=True)
class Difference:
    """The first sample at which log and replay differ.

    - `tick`, `t`: tick and time of the sample [s].
    - `joint`: index of the joint whose torque differs most, from 0; None if the bits of all torques are the same.
    - `logged`, `again`: torque of this joint in the log, and in the replay [N m or N].
    - `status`: status bits in the log, and in the replay.
    """

    tick: int
    t: float
    joint: int | None
    logged: float
    again: float
    status: tuple[int, int]

    def distance_text(self) -> str:
        """Return in words how far the two torques are apart."""
        if self.logged == self.again:
            return "which differs in the sign of zero"
        if np.isnan(self.logged) and np.isnan(self.again):
            return "which differs in the bits of NaN"
        return f"{abs(self.again - self.logged):.2g} off"


@dataclass(frozen=True)
class Replay:
    """Result of a replay, which computes logged answers again. An answer is the law's torque and status at a sample.

    - `answers`: number of compared answers.
    - `same`: number of answers whose bits are the same in log and replay.
    - `first`: the first difference; None if there is none.
    - `largest`: largest difference of a torque [N m or N].
    - `joints`, `bits`: names of the joints, and of the status bits.
    - `unknown`: number of answers that could not be compared: the law's memory depends on an answer that the log lacks.
    """

    answers: int
    same: int
    first: Difference | None
    largest: float
    joints: tuple[str, ...]
    bits: tuple[str, ...]
    unknown: int

    def sentence(self) -> str:
        """Return the result in words."""
        text = f"{self.same} of {count_noun(self.answers, 'answer')} have the same bits"
        if self.unknown:
            text += f" ({self.unknown} more continue from an answer missing in the log)"
        if self.first is None:
            return f"{text}."
        difference = self.first
        what = (
            f"{self.joints[difference.joint]} was commanded {difference.logged!r}, and is now {difference.again!r}, "
            f"{difference.distance_text()}"
            if difference.joint is not None
            else "the torques are the same, the status is not"
        )
        was, is_ = ("+".join(names_of_bits(self.bits, status)) or "OK" for status in difference.status)
        status = "" if was == is_ else f"; status {was}, and now {is_}"
        return (
            f"{text}; the first difference is at tick {difference.tick}, t = {difference.t:g} s: {what}{status}. "
            f"At most, a torque is {self.largest:.2g} off."
        )

    def as_json(self) -> dict[str, Any]:
        """Return the result as JSON data."""
        values = asdict(self)
        first = values["first"]
        if first is not None:
            first |= {"joint": None if first["joint"] is None else self.joints[first["joint"]]}
        return {name: values[name] for name in ("answers", "same", "first", "largest", "unknown")}


def replay(log: SavedLog) -> Replay:
    """Run the law of a log's scenario again on each logged measurement, and compare torque and status with the log.

    At each sample the law starts from the memory that it had there in the logged run.

    Raises DefinitionError if the log has no row of the law, if its scenario is invalid or has other signals than the
    log, or if llvmlite is missing.
    """
    scenario = restore(log.scenario, log.files, log.name)
    plan = law_plan(scenario)
    rows = len(log.law["k"])
    if not rows:
        raise DefinitionError(f"`{log.path}` has no torque computed by a law, so that it cannot be replayed")
    if plan.channels != log.channels:
        raise DefinitionError(
            f"`{log.path}` has other joints or signals than the law of the scenario in it: replay it with the "
            "version of slidax that wrote it"
        )
    law = LawSide(plan.plan, scenario.period)
    samples = np.zeros(rows, plan.sample)
    for name in plan.sample.names or ():
        samples[name] = log.law[name]
    inputs = samples.view(np.uint8).reshape(rows, -1)
    again = np.zeros((rows, law.row.size), np.uint8)
    known = np.ones(rows, bool)
    for row, (k, basis) in enumerate(zip(log.law["k"].tolist(), log.law["basis"].tolist(), strict=True)):
        known[row] = law.repeat(inputs[row], k, basis)
        again[row] = law.row
    if not known.all():
        # After a lost answer the law's memory is unknown, so all later answers cannot be compared.
        known[int(np.argmin(known)) :] = False
    repeated = plan.columns(again)
    wrong = np.zeros(rows, bool)
    for name in COMPARED:
        wrong |= _bits_differ(repeated[name], log.law[name]).reshape(rows, -1).any(axis=1)
    wrong &= known
    off = _distances(repeated["tau"], log.law["tau"])[known]
    return Replay(
        answers=int(known.sum()),
        same=int((known & ~wrong).sum()),
        first=_first(log.law, repeated, int(np.argmax(wrong))) if wrong.any() else None,
        largest=float(np.nanmax(off, initial=0.0)),
        joints=log.channels.joints,
        bits=log.channels.bits,
        unknown=int((~known).sum()),
    )


def _bits_differ(left: np.ndarray, right: np.ndarray) -> np.ndarray:
    return left.view(f"u{left.itemsize}") != right.view(f"u{right.itemsize}")


def _distances(left: np.ndarray, right: np.ndarray) -> np.ndarray:
    # The distance of two infinite torques is NaN.
    with np.errstate(invalid="ignore"):
        return np.abs(left - right)


def _first(logged: dict[str, np.ndarray], again: dict[str, np.ndarray], row: int) -> Difference:
    differs = _bits_differ(again["tau"][row], logged["tau"][row])
    # A torque whose bits are the same, also an infinite one, is never the one that differs most.
    off = np.where(differs, _distances(again["tau"][row], logged["tau"][row]), -1.0)
    joint = int(np.argmax(off)) if differs.any() else None
    return Difference(
        tick=int(logged["k"][row]),
        t=float(logged["t"][row]),
        joint=joint,
        logged=float(logged["tau"][row][joint or 0]),
        again=float(again["tau"][row][joint or 0]),
        status=(int(logged["status"][row]), int(again["status"][row])),
    )
