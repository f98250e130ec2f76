"""Causes for leaving the envelope, their findings, and remedies."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from shlex import quote
from typing import Any, ClassVar

from .record import Record


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
    def finding(self, record: Record) -> Finding | None:
        """Return the evidence for this cause in the log; None if there is none."""


def _as_yaml(value: Any) -> str:
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{key}: {_as_yaml(entry)}" for key, entry in value.items()) + "}"
    if isinstance(value, list | tuple):
        return "[" + ",".join(_as_yaml(entry) for entry in value) + "]"
    if value is None:
        return "null"
    return f"{value:.4g}" if isinstance(value, float) else str(value)
