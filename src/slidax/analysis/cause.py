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
from slidax.core.errors import percent

from .run_record import RunRecord


@dataclass(frozen=True)
class Remedy:
    """A proposed change with which a run may keep its envelope, or a guarantee may hold.

    - `words`: the proposal in words.
    - `changes`: new values by dotted path of the scenario file, such as `sensor.resolution`; empty for a remedy outside
      the file.
    """

    words: str
    changes: Mapping[str, Any]

    @property
    def sets(self) -> str:
        """The changes as options of `slidax run`: `--set PATH=VALUE`, separated by spaces."""
        return " ".join(f"--set {quote(f'{path}={_as_yaml(value)}')}" for path, value in self.changes.items())


@dataclass(frozen=True)
class Finding:
    """Evidence for a cause in a run's log.

    - `name`: name of the cause.
    - `joint`: index of the joint, from 0; None if the cause concerns all joints.
    - `weight`: rough likelihood that this cause made the run leave its envelope, from 0 to 1; it ranks the findings.
    - `evidence`: a sentence with the values.
    - `numbers`: the values in the evidence, by name.
    - `remedies`: possible remedies, the best first.
    """

    name: str
    joint: int | None
    weight: float
    evidence: str
    numbers: Mapping[str, float]
    remedies: Sequence[Remedy] = field(default=())


class AbstractCause(ABC):
    """A cause for leaving the envelope, and its detection in a log."""

    name: ClassVar[str]

    @abstractmethod
    def finding(self, record: RunRecord) -> Finding | None:
        """Return the evidence for this cause in the record of a run; None if there is none."""


def _as_yaml(value: Any) -> str:
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{key}: {_as_yaml(entry)}" for key, entry in value.items()) + "}"
    if isinstance(value, list | tuple):
        return "[" + ",".join(_as_yaml(entry) for entry in value) + "]"
    if value is None:
        return "null"
    return f"{value:.4g}" if isinstance(value, float) else str(value)


FACTORS = (0.7, 0.5)
"""Factors of the motion's speed to try."""


def slower_motion(record: RunRecord) -> list[Remedy]:
    """Return remedies that slow the motion down; empty if the motion has no frequency, times or rates."""
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
            remedies.append(Remedy(f"go {percent(1.0 - factor)} slower", changes))
    return remedies


def data_sheet_limit(record: RunRecord, name: str) -> np.ndarray:
    """Return a limit of each joint from the nominal arm's description [n]; 0 for a joint without this limit.

    - `name`: `torque` (N m or N) or `torque_rate` (N m/s or N/s).
    """
    robot = record.nominal
    if not isinstance(robot, Articulated | Coupled):
        return np.zeros(record.joints)
    limit = np.asarray(getattr(robot.limits, name))
    return np.where(np.isfinite(limit), limit, 0.0)
