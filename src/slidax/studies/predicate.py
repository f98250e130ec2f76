"""Properties of runs: the envelope is kept, or a metric is small enough."""

from __future__ import annotations

import operator
import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slidax._errors import DefinitionError, nearest, plain

from .table import Columns

ENVELOPE = "envelope"
"""The predicate that the envelope holds from the beginning to the end."""

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

    - `text`: `envelope`, or a metric, a sign and a number, such as `steady_error < 1e-3`; of the worst joint.
    """

    text: str

    def __post_init__(self) -> None:
        self._parsed()

    def holds(self, columns: Columns) -> NDArray[np.bool_]:
        """Return True for each row with the property; a run that ended early, or lacks the metric, has no property.

        - `columns`: outcome and metrics.

        Raises DefinitionError if there is no such metric.
        """
        outcome = np.asarray(columns["outcome"])
        parsed = self._parsed()
        if parsed is None:
            if np.isnan(columns["margin"]).all() and not outcome.any():
                raise DefinitionError("the scheme draws no envelope: ask for a metric, such as `steady_error < 1e-3`")
            return outcome == 0
        name, sign, limit = parsed
        if name not in columns:
            raise DefinitionError(f"there is no metric `{plain(name)}`; {nearest(name, columns)}", where="holds")
        ended = (outcome == 1) | (outcome == 2)
        return SIGNS[sign](columns[name], limit) & ~ended

    def _parsed(self) -> tuple[str, str, float] | None:
        if self.text == ENVELOPE:
            return None
        match = FORM.fullmatch(self.text)
        try:
            name, sign, number = match.groups() if match else ("", "", "")
            limit = float(number)
        except ValueError:
            raise DefinitionError(
                f"must be `{ENVELOPE}`, or a metric, a sign and a number, such as `steady_error < 1e-3`; "
                f"got `{plain(self.text)}`",
                where="holds",
            ) from None
        return name, sign, limit
