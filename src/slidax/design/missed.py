"""Estimation errors of a law in simulated cases, against the loop-rate rule."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from slidax.certificates.verdict import Verdict
from slidax.studies.cases import Cases, Values

from .choice import Choice, Floats
from .trials import Trials

FEW = 8
"""Cases that are looked at."""

MOST = 3
"""Joints that a sentence names."""

NARROW = 1.05
"""An envelope has reached its final width where it is at most so many times as wide as at the end."""


@dataclass(frozen=True)
class Missed:
    """Estimation error of each joint's plan, and its bound by the rule, `(H + D h)² w̄ < ϑ ρ∞` (docs/loop-rate.md).

    - `names`, `units`: of the joints, and of their positions.
    - `missed`: w̄ [n], `allowed`: by the rule [n], rad/s² or m/s².
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    missed: Floats
    allowed: Floats

    @property
    def beyond(self) -> list[int]:
        """The joints that miss more than the rule allows, the worst first."""
        ratio = np.nan_to_num(self.missed / self.allowed, nan=np.inf)
        return [int(k) for k in np.argsort(-ratio) if ratio[k] >= 1.0]

    def in_words(self) -> str:
        """`joint 6` misses 41 rad/s² (rule: 28), for some of the joints that are beyond it; empty if none is."""
        text = [
            f"`{self.names[k]}` misses {self.missed[k]:.3g} {self.units[k]}/s² (rule: {self.allowed[k]:.3g})"
            for k in self.beyond[:MOST]
        ]
        return ", ".join(text)

    def as_json(self) -> dict[str, Any]:
        """By the names of the joints."""
        each = zip(self.names, self.missed, self.allowed, strict=True)
        return {name: {"misses": float(missed), "rule": float(allowed)} for name, missed, allowed in each}


def missed_in_cases(trials: Trials, choice: Choice) -> Missed:
    """Return the estimation errors in the first common cases while the envelope is narrow.

    - `trials`: on what.
    - `choice`: the law.
    """
    told, cases = trials.frame.values(choice), trials.cases(FEW)
    rows = len(next(iter(cases.values()))) if cases else 1
    values: Values = {
        **cases,
        **{path: np.repeat(np.asarray([item], float), rows, axis=0) for path, item in told.items()},
    }
    delay, h = trials.frame.delay, trials.frame.period
    worst = []
    for run in Cases(trials.family).logged(values):
        log = run.log
        assert log is not None
        assert log.envelope is not None
        width = np.asarray(log.envelope.upper) - np.asarray(log.envelope.lower)
        narrow = np.all(width <= NARROW * width[-1], axis=1)[1:]
        residual, push = (np.asarray(log.signals[name]) for name in ("residual", "push"))
        each = np.abs(residual[1:]) + delay * np.abs(np.diff(push, axis=0))
        worst.append(np.max(each[narrow] if narrow.any() else each, axis=0))
    arm = trials.problem.robot.build().nominal
    allowed = choice.overshoot * np.asarray(choice.final) / (choice.horizon + delay * h) ** 2
    return Missed(arm.joint_names, arm.joint_units, np.max(worst, axis=0), allowed)


def missed_by(rate: Verdict, trials: Trials, choice: Choice) -> Missed | None:
    """Return the bound of `loop_rate` on the estimation errors; None without one.

    - `rate`: the certificate's answer.
    - `trials`: of which arm.
    - `choice`: the law.
    """
    if "w_bar" not in rate.bound:
        return None
    arm = trials.problem.robot.build().nominal
    allowed = choice.overshoot * np.asarray(choice.final) / choice.horizon**2
    return Missed(arm.joint_names, arm.joint_units, np.asarray(rate.bound["w_bar"], float), allowed)
