"""When a study has shown what it is asked for: runs are looked at in order, one after the other."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from slidax._errors import counted
from slidax.scenarios.base import AbstractDescription, said

from .predicate import Predicate
from .result import all_done
from .statistics import confidence_sequence
from .table import Columns


class UntilDescription(AbstractDescription):
    """When to stop before all runs are done."""

    probability: float = said("that is to be shown: at least so many of all cases hold", "", "(0, 1)")
    failures: Annotated[int, Field(ge=1)] = 1
    """Stop at so many failures."""


class Counted:
    """Looks at the rows in order, and says when there are enough.

    - `until`: when that is; None: never.
    - `confidence`: of the sequence.
    """

    def __init__(self, until: UntilDescription | None, confidence: float) -> None:
        self.until = until
        self.confidence = confidence
        self.runs = 0
        self._failures = 0
        self._shown = False

    def enough(self, parts: dict[int, Columns], predicate: Predicate) -> bool:
        """Return True to stop; looks at the rows that have none missing before them, one after the other.

        - `parts`: the rows that are done, by the number of the first.
        - `predicate`: what is counted.
        """
        if self.until is None:
            return False
        while (part := next((p for f, p in parts.items() if f <= self.runs < f + len(p["row"])), None)) is not None:
            held = predicate.holds(part)[self.runs - int(part["row"][0]) :]
            for item in held.tolist():
                self.runs += 1
                self._failures += not item
                if self._failures >= self.until.failures:
                    return True
                if item and self._is_shown():
                    self._shown = True
                    return True
        return False

    def _is_shown(self) -> bool:
        if self.until is None:
            return False
        # So few runs cannot show it, whatever they are: the search for the interval is spared.
        if self.runs * (1.0 - self.until.probability) < 1.0:
            return False
        return 1.0 - confidence_sequence(self._failures, self.runs, self.confidence).upper >= self.until.probability

    def stored(self, parts: dict[int, Columns]) -> int:
        """Number of rows before the first missing row.

        - `parts`: the rows that are done.
        """
        count = 0
        while count in parts:
            count += len(parts[count]["row"])
        return count

    def ended(self, runs: int) -> str:
        """Why it ended.

        - `runs`: how many there were to be.
        """
        if self.until is None:
            return all_done(runs)
        if self._shown:
            return f"shown after {counted(self.runs, 'run')}"
        if self._failures >= self.until.failures:
            return f"stopped at failure {self._failures}, in run {self.runs}"
        return f"not decided by all of {counted(runs, 'run')}"
