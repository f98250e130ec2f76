"""Explain why a run left its envelope, with remedies that were tried in simulation."""

from __future__ import annotations

import math
import time
import warnings
from dataclasses import dataclass
from typing import Any

from slidax._errors import DefinitionError
from slidax.scenarios import Scenario, altered
from slidax.simulation import Run

from .cause import AbstractCause, Finding, Remedy
from .causes import (
    Contact,
    Delay,
    Encoder,
    Estimator,
    Inertia,
    Payload,
    Period,
    RobustTorque,
    Substeps,
    Torque,
    TorqueRate,
)
from .record import Record, require_explainable

CAUSES: tuple[AbstractCause, ...] = (
    Inertia(),
    Delay(),
    Estimator(),
    Encoder(),
    Contact(),
    Payload(),
    Torque(),
    TorqueRate(),
    RobustTorque(),
    Substeps(),
    Period(),
)
"""All that are looked for."""

MOST_TRIED = 4
"""Causes whose remedies are tried: each trial is a run."""


@dataclass(frozen=True)
class Answer:
    """A cause, with its remedy.

    - `finding`: what the log shows.
    - `remedy`: the first that made the run hold, or else the first; None if there is none.
    - `tried`: whether a run was made with it.
    - `holds`: whether that run kept its envelope.
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
        outcome = "tried, the run holds" if self.holds else "tried, not enough by itself" if self.tried else "not tried"
        return f"{self.finding.evidence}. Remedy: {self.remedy.words}{sets} ({outcome})."

    def as_json(self) -> dict[str, Any]:
        """For programs; joints are counted from 1."""
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


def explained(scenario: Scenario, run: Run | Record, *, tries: bool = True, seconds: float = math.inf) -> list[Answer]:
    """The causes that the log shows, most likely first; empty if it shows none.

    They are weighed by what the log shows. The remedies of the likeliest are then tried in simulation, until the run
    holds with one: that cause is the first of the answer.

    - `scenario`: what was run.
    - `run`: its run, with each sample in its log, or the record of one.
    - `tries`: whether remedies are tried.
    - `seconds`: after so many no further remedy is tried.

    Raises DefinitionError if the log has not each sample, or the scheme is not in sampled-data form with an envelope.
    """
    until = time.monotonic() + seconds
    record = run if isinstance(run, Record) else Record.of(scenario, run)
    if record.kept:
        return []
    findings = [finding for finding in (cause.finding(record) for cause in CAUSES) if finding is not None]
    findings.sort(key=lambda finding: -finding.weight)
    answers: list[Answer] = []
    held = False
    for finding in findings:
        may = tries and not held and len(answers) < MOST_TRIED and not scenario.changed
        answer = _tried(scenario, finding, until) if may else Answer(finding, next(iter(finding.remedies), None))
        held = held or answer.holds
        answers.append(answer)
    return sorted(answers, key=lambda answer: not answer.holds)


def first_line(scenario: Scenario, *, seconds: float) -> str:
    """The likeliest cause and its remedy in one line; empty if none is found, or the scheme cannot be diagnosed.

    - `scenario`: what left its envelope; it is run again with each sample in the log.
    - `seconds`: after so many no further remedy is tried.
    """
    try:
        require_explainable(scenario)
        answers = explained(scenario, scenario.simulate(log_every=1, progress=False), seconds=seconds)
    except DefinitionError:
        return ""
    return answers[0].sentence() if answers else ""


def _tried(scenario: Scenario, finding: Finding, until: float) -> Answer:
    tried = False
    for remedy in finding.remedies:
        if not remedy.changes or time.monotonic() > until:
            continue
        holds = _holds(scenario, remedy)
        tried = tried or holds is not None
        if holds:
            return Answer(finding, remedy, tried=True, holds=True)
    return Answer(finding, next(iter(finding.remedies), None), tried=tried)


def _holds(scenario: Scenario, remedy: Remedy) -> bool | None:
    """True if the run keeps its envelope with the remedy; None if it cannot be run."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return altered(scenario, dict(remedy.changes)).simulate(log_every=None, progress=False).outcome.ok
    except DefinitionError:
        return None
