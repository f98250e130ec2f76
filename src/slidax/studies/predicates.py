"""Properties of runs, and the rule that stops a study once a property is shown."""

from __future__ import annotations

import operator
import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from slidax.core.errors import DefinitionError, count_noun, parse_number, plain_name
from slidax.scenarios.descriptions import AbstractDescription, input_field

from .cases import Columns, require_metric
from .statistics import confidence_sequence
from .study import all_done

ENVELOPE = "envelope"
"""The property that a run stays inside its envelope until its end."""

SIGNS: dict[str, Callable[[Any, Any], Any]] = {
    "<": operator.lt,
    "<=": operator.le,
    ">": operator.gt,
    ">=": operator.ge,
}

FORM = re.compile(r"\s*([A-Za-z_][\w.\-]*)\s*(<=|>=|<|>)\s*([-+.\deE]+)\s*")


@dataclass(frozen=True)
class Predicate:
    """A property of a run.

    - `text`: `envelope`, or a metric, a sign and a number, such as `steady_error < 1e-3`, for the worst joint.
    """

    text: str

    def __post_init__(self) -> None:
        self._parsed()

    def holds(self, columns: Columns) -> NDArray[np.bool_]:
        """Return True for each row with the property; False if the run ended early or lacks the metric.

        - `columns`: table with outcome and metrics of the runs.

        Raises DefinitionError if there is no such metric.
        """
        outcome = np.asarray(columns["outcome"])
        parsed = self._parsed()
        if parsed is None:
            if np.isnan(columns["margin"]).all() and not outcome.any():
                raise DefinitionError(
                    "the scheme has no envelope: in place of `envelope` use a metric, such as `steady_error < 1e-3`"
                )
            return outcome == 0
        name, sign, limit = parsed
        require_metric(name, columns, "holds")
        ended = (outcome == 1) | (outcome == 2)
        return SIGNS[sign](columns[name], limit) & ~ended

    def _parsed(self) -> tuple[str, str, float] | None:
        if self.text == ENVELOPE:
            return None
        match = FORM.fullmatch(self.text)
        try:
            name, sign, number = match.groups() if match else ("", "", "")
            limit = parse_number(number)
        except ValueError:
            raise DefinitionError(
                f"must be `{ENVELOPE}`, or a metric, a sign and a number, such as `steady_error < 1e-3`; "
                f"got `{plain_name(self.text)}`",
                where="holds",
            ) from None
        return name, sign, limit


class UntilDescription(AbstractDescription):
    """Rule for stopping before all runs are done."""

    probability: float = input_field(
        "the study stops once it shows that the property has at least this probability", "", "(0, 1)"
    )
    failures: Annotated[int, Field(ge=1)] = 1
    """Number of failures at which the study stops."""


class SequentialStop:
    """Counts failures in the order of the rows, and decides when to stop.

    - `until`: the stopping rule; None for no early stop.
    - `confidence`: confidence of the confidence sequence for the property's failure rate.
    """

    def __init__(self, until: UntilDescription | None, confidence: float) -> None:
        self.until = until
        self.confidence = confidence
        self.runs = 0
        self._failures = 0
        self._shown = False

    def enough(self, parts: dict[int, Columns], predicate: Predicate) -> bool:
        """Count failures in the completed rows, in order up to the first missing row; return True to stop the study.

        - `parts`: columns of the completed chunks, by the number of the chunk's first row.
        - `predicate`: the property whose failures are counted.
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
        # So few runs can never show the property: skip the costly interval.
        if self.runs * (1.0 - self.until.probability) < 1.0:
            return False
        return 1.0 - confidence_sequence(self._failures, self.runs, self.confidence).upper >= self.until.probability

    def stored(self, parts: dict[int, Columns]) -> int:
        """Return the number of completed rows before the first missing row.

        - `parts`: as in `enough`.
        """
        count = 0
        while count in parts:
            count += len(parts[count]["row"])
        return count

    def ended(self, runs: int) -> str:
        """Return the reason for the end of the study in words, such as “stopped at failure 1, in run 20”.

        - `runs`: planned number of runs.
        """
        if self.until is None:
            return all_done(runs)
        if self._shown:
            return f"shown after {count_noun(self.runs, 'run')}"
        if self._failures >= self.until.failures:
            return f"stopped at failure {self._failures}, in run {self.runs}"
        return f"undecided after {count_noun(runs, 'run')}"
