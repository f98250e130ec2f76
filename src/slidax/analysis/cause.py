"""Causes for leaving the envelope: findings in a run's log, and remedies."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from shlex import quote
from typing import Any, ClassVar

import numpy as np

from slidax.arms.articulated import Articulated
from slidax.arms.coupled import Coupled

from .run_record import RunRecord


@dataclass(frozen=True)
class Remedy:
    """One thing to do.

    - `words`: what, for a person.
    - `changes`: the same as values by their paths in the scenario file; empty for what no file says.
    """

    words: str
    changes: Mapping[str, Any]

    @property
    def sets(self) -> str:
        """The changes as options of `slidax run`."""
        return " ".join(f"--set {quote(f'{path}={_as_yaml(value)}')}" for path, value in self.changes.items())


@dataclass(frozen=True)
class Finding:
    """Evidence for a cause in a run's log.

    - `name`: of the cause.
    - `joint`: which joint it is about, from 0; None for all.
    - `weight`: how likely it is why the run left, from 0 to 1: above .8 it explains it by itself.
    - `evidence`: one sentence with the numbers.
    - `numbers`: the same by name.
    - `remedies`: what may help, the best first.
    """

    name: str
    joint: int | None
    weight: float
    evidence: str
    numbers: Mapping[str, float]
    remedies: Sequence[Remedy] = field(default=())


class AbstractCause(ABC):
    """One reason for which a run leaves its envelope, and how a log shows it."""

    name: ClassVar[str]

    @abstractmethod
    def finding(self, record: RunRecord) -> Finding | None:
        """Return the evidence for this cause in the log; None if there is none."""


def _as_yaml(value: Any) -> str:
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{key}: {_as_yaml(entry)}" for key, entry in value.items()) + "}"
    if isinstance(value, list | tuple):
        return "[" + ",".join(_as_yaml(entry) for entry in value) + "]"
    if value is None:
        return "null"
    return f"{value:.4g}" if isinstance(value, float) else str(value)


FACTORS = (0.7, 0.5)
"""Of the speed."""


def slower_motion(record: RunRecord) -> list[Remedy]:
    """The motion at a part of its speed, where its kind has a number for that."""
    motion: Any = record.scenario.description.trajectory
    remedies = []
    for factor in FACTORS:
        changes = {}
        for name, power in (("frequency", 1.0), ("times", -1.0), ("rates", 1.0)):
            value = getattr(motion, name, None)
            if value is not None:
                numbers = np.round(np.asarray(value, float) * factor**power, 6)
                changes[f"trajectory.{name}"] = numbers.tolist()
        if changes:
            remedies.append(Remedy(f"go {1.0 - factor:.0%} slower", changes))
    return remedies


def data_sheet_limit(record: RunRecord, name: str) -> np.ndarray:
    """A limit of the joints by the arm's description [n]; 0 where it has none.

    - `name`: `torque` or `torque_rate`.
    """
    robot = record.nominal
    if not isinstance(robot, Articulated | Coupled):
        return np.zeros(record.joints)
    limit = np.asarray(getattr(robot.limits, name))
    return np.where(np.isfinite(limit), limit, 0.0)
