"""Two ends, and how surely the truth lies between them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from slidax._errors import DefinitionError, shown


@dataclass(frozen=True)
class Interval:
    """Holds the truth in at least this share of all studies that are made so.

    - `lower`, `upper`: the ends.
    - `confidence`: the share, in (0, 1).
    """

    lower: float
    upper: float
    confidence: float

    def __contains__(self, value: float) -> bool:
        return self.lower <= value <= self.upper


def require_confidence(confidence: Any) -> None:
    """Raises DefinitionError unless it is a share between 0 and 1.

    - `confidence`: of an interval.
    """
    if not 0.0 < confidence < 1.0:
        raise DefinitionError(f"`confidence` must be in (0, 1), as 0.95; got {shown(confidence)}")


def require_counts(failures: int, runs: int) -> None:
    """Raises DefinitionError unless so many runs can have failed.

    - `failures`: how many failed.
    - `runs`: of how many.
    """
    if not 0 <= failures <= runs:
        raise DefinitionError(f"`failures` must be in [0, runs]; got {shown(failures)} of {shown(runs)} runs")
