"""Explain why a run left its envelope: search for causes, and try their remedies in simulation."""

from __future__ import annotations

import math
import time
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from slidax.core.errors import DefinitionError, DefinitionWarning
from slidax.runtime.logs.mcap_files import SavedLog, read_mcap
from slidax.scenarios.load import alter, load, restore
from slidax.scenarios.scenario import Scenario
from slidax.simulation.parquet import read_columns
from slidax.simulation.run import Run

from .cause import AbstractCause, Finding, Remedy
from .loop_causes import DelayCause, EncoderCause, EstimatorCause, InertiaCause, PeriodCause, SubstepsCause
from .run_record import RunRecord, require_explainable
from .torque_causes import ContactCause, PayloadCause, RobustTorqueCause, TorqueCause, TorqueRateCause

CAUSES: tuple[AbstractCause, ...] = (
    InertiaCause(),
    DelayCause(),
    EstimatorCause(),
    EncoderCause(),
    ContactCause(),
    PayloadCause(),
    TorqueCause(),
    TorqueRateCause(),
    RobustTorqueCause(),
    SubstepsCause(),
    PeriodCause(),
)
"""All causes that `explain` checks."""

MOST_TRIED = 4
"""Largest number of causes whose remedies are tried; each trial simulates the run again."""


@dataclass(frozen=True)
class Explanation:
    """A cause for which a run left its envelope, and its remedy.

    - `finding`: the evidence in the log.
    - `remedy`: the first remedy with which the run keeps its envelope, or the first of all if none helps; None if the
      cause has no remedy.
    - `tried`: True if remedies were simulated.
    - `holds`: True if the run keeps its envelope with the remedy.
    """

    finding: Finding
    remedy: Remedy | None
    tried: bool = False
    holds: bool = False

    def sentence(self) -> str:
        """Evidence and remedy in one line."""
        if self.remedy is None:
            return f"{self.finding.evidence}."
        sets = f": `{self.remedy.sets}`" if self.remedy.changes else ""
        outcome = "tried successfully" if self.holds else "tried, not enough alone" if self.tried else "not tried"
        return f"{self.finding.evidence}. Remedy: {self.remedy.words}{sets} ({outcome})."

    def as_json(self) -> dict[str, Any]:
        """The explanation as a dictionary for JSON; joints are counted from 1."""
        finding, remedy = self.finding, self.remedy
        return {
            "name": finding.name,
            "joint": None if finding.joint is None else finding.joint + 1,
            "weight": round(finding.weight, 3),
            "evidence": finding.evidence,
            "numbers": dict(finding.numbers),
            "remedy": None if remedy is None else remedy.words,
            "changes": {} if remedy is None else dict(remedy.changes),
            "tried": self.tried,
            "holds": self.holds,
        }


def explain(
    scenario: Scenario, run: Run | RunRecord, *, tries: bool = True, seconds: float = math.inf
) -> list[Explanation]:
    """Return the causes that a run's log shows, the likeliest first; empty if the run kept its envelope.

    The list is also empty if the log shows no cause. Causes are sorted by their weight (`Finding`). The remedies of up
    to `MOST_TRIED` causes are then tried in simulation, until the run keeps its envelope with one of them. The cause
    with that remedy then comes first. No remedy is tried for a scenario that `Scenario.replace` changed.

    - `scenario`: the scenario of the run.
    - `run`: the run, with every sample in its log, or its `RunRecord`.
    - `tries`: True to try remedies.
    - `seconds`: time limit after which no further remedy is tried [s].

    Raises DefinitionError if the log lacks samples, or the run cannot be diagnosed (`require_explainable`).
    """
    until = time.monotonic() + seconds
    record = run if isinstance(run, RunRecord) else RunRecord.of(scenario, run)
    if record.kept:
        return []
    findings = [finding for finding in (cause.finding(record) for cause in CAUSES) if finding is not None]
    findings.sort(key=lambda finding: -finding.weight)
    answers: list[Explanation] = []
    held = False
    for finding in findings:
        may = tries and not held and len(answers) < MOST_TRIED and not scenario.changed
        answer = (
            _try_remedies(scenario, finding, until) if may else Explanation(finding, next(iter(finding.remedies), None))
        )
        held = held or answer.holds
        answers.append(answer)
    return sorted(answers, key=lambda answer: not answer.holds)


def likeliest_cause(scenario: Scenario, *, seconds: float) -> str:
    """The likeliest cause and its remedy in one line; empty if no cause shows, or the scheme cannot be diagnosed.

    - `scenario`: the scenario whose run left its envelope; it is run again with every sample in the log.
    - `seconds`: time limit after which no further remedy is tried [s].
    """
    try:
        require_explainable(scenario)
        answers = explain(scenario, scenario.simulate(log_every=1, progress=False), seconds=seconds)
    except DefinitionError:
        return ""
    return answers[0].sentence() if answers else ""


def _try_remedies(scenario: Scenario, finding: Finding, until: float) -> Explanation:
    tried = False
    for remedy in finding.remedies:
        if not remedy.changes or time.monotonic() > until:
            continue
        holds = _holds(scenario, remedy)
        tried = tried or holds is not None
        if holds:
            return Explanation(finding, remedy, tried=True, holds=True)
    return Explanation(finding, next(iter(finding.remedies), None), tried=tried)


def _holds(scenario: Scenario, remedy: Remedy) -> bool | None:
    """True if the run keeps its envelope with the remedy; None if the changed scenario cannot run."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return alter(scenario, dict(remedy.changes)).simulate(log_every=None, progress=False).outcome.ok
    except DefinitionError:
        return None


SCENARIO, LOG = "scenario.yaml", "log.parquet"
"""The files of a saved run."""


def read_saved(saved: str | Path) -> tuple[Scenario, dict[str, np.ndarray], bool]:
    """Return a saved run's scenario, the run's log, and True if the log has every sample.

    The log maps each column's name to an array over the samples; `q_1` is the position of joint 1.

    - `saved`: a folder that `slidax run --out` has written, or an MCAP file.

    Raises DefinitionError if a file is missing or not from slidax, or the package that reads it is not installed.
    """
    saved = Path(saved)
    if saved.suffix == ".mcap":
        log = read_mcap(saved)
        if not log.complete:
            warnings.warn(
                f"`{saved}` is truncated or damaged: only its intact part is read", DefinitionWarning, stacklevel=2
            )
        return restore(log.scenario, log.files, log.name), _columns(log), True
    for name in (SCENARIO, LOG):
        if not (saved / name).is_file():
            raise DefinitionError(
                f"`{saved}` has no `{name}`: give an MCAP file, or the folder of a run that `slidax run SCENARIO --out "
                "FOLDER` has written"
            )
    columns = read_columns(saved / LOG)
    scenario = load(saved / SCENARIO)
    return scenario, columns, scenario.log_every == 1


def _columns(log: SavedLog) -> dict[str, np.ndarray]:
    """Convert an MCAP log to an array per column, by name, with an entry for each sample of the arm.

    Where the law sent no command, the entry repeats the values of its last command.
    """
    arm, law = log.arm, log.law
    if not len(arm["true_k"]) or not len(law["k"]):
        raise DefinitionError(
            f"`{log.path}` has no samples of a simulated arm (topic `/truth`), or no command of the law: a diagnosis "
            "needs both, as `slidax run` and `slidax loop` record them"
        )
    answer = np.maximum(np.searchsorted(law["k"], arm["true_k"], side="right") - 1, 0)
    signals: dict[str, np.ndarray] = {
        "q": arm["true_q"],
        "dq": arm["true_dq"],
        "e": arm["true_e"],
        "tau": arm["set_tau"],
        # From the arm's own log, since the reference in the law's last answer may be old.
        "q_d": arm["true_q"] - arm["true_e"],
        **{name: law[name][answer] for name in ("dq_d", "ddq_d", "lower", "upper") if name in law},
    }
    signals |= {name: law[f"signal:{name}"][answer] for name in log.channels.signals}
    table = {"k": arm["true_k"], "t": arm["true_t"]}
    for name, values in signals.items():
        if values.ndim == 1:
            table[name] = values
            continue
        table |= {f"{name}_{joint + 1}": column for joint, column in enumerate(values.T)}
    return table
