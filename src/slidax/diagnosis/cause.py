"""What a cause is, and what it finds."""

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
    """What a cause has found in a run.

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
        """What the log shows of this cause; None if nothing.

        - `record`: the run that left its envelope.
        """


def _as_yaml(value: Any) -> str:
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{key}: {_as_yaml(one)}" for key, one in value.items()) + "}"
    if isinstance(value, list | tuple):
        return "[" + ",".join(_as_yaml(one) for one in value) + "]"
    if value is None:
        return "null"
    return f"{value:.4g}" if isinstance(value, float) else str(value)
