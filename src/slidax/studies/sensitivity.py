"""Which of the uncertain numbers matter."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from pydantic import Field

from slidax._errors import DefinitionError, counted, nearest, plain
from slidax.scenarios.base import said
from slidax.scenarios.family import Family

from .asked import Asked
from .result import AbstractResult, Cell, Drawn, Section, all_done, worst_of
from .search import SobolIndices, points_for_indices, sobol_indices
from .study import AbstractStudy, How
from .table import Columns

OF = ("margin", "steady_error", "max_torque_step")


class Sensitivity(AbstractStudy):
    """Sobol indices: what share of the variance of a result is due to each of the uncertain numbers.

    `first` is what a number does by itself, `total` that and what it does together with others.
    """

    in_parts: ClassVar[bool] = True
    study: Literal["sensitivity"]
    base: Annotated[int, Field(ge=2, le=2**24)] = 256
    """A power of two; so many times two more than there are numbers is how many runs there are."""
    of: Annotated[tuple[str, ...], Field(min_length=1)] = OF
    """The results: `margin`, or metrics such as `steady_error`."""
    each: Literal["path", "number"] = "path"
    """`path`: all numbers of a path, such as the friction of all joints, have one share; `number`: each its own."""
    confidence: float = said("of the intervals", "", "(0, 1)", default=0.95)

    def run(self, how: How) -> SensitivityResult:
        """The shares with their intervals.

        - `how`: where, and what is told on the way.
        """
        family = self.family()
        space = family.space
        self.require(bool(space.sets), "uncertainty", "is empty: there is nothing whose share could be found")
        self.require(self.base & (self.base - 1) == 0, "base", f"must be a power of two, such as 256; got {self.base}")
        names = list(space.widths) if self.each == "path" else space.coordinates
        groups = list(space.widths.values()) if self.each == "path" else [1] * space.dimensions
        cube = points_for_indices(groups, self.base, seed=self.seed)
        runner = self.runner(family, how)
        asked = Asked(runner, space)
        how.begin(len(cube))
        table = asked.points(cube)
        indices, missing = {}, {}
        for one in self.of:
            if one not in table:
                raise DefinitionError(f"there is no metric `{plain(one)}`; {nearest(one, table)}", where="of")
            wrong = int(np.sum(~np.isfinite(table[one])))
            if wrong:
                missing[one] = wrong
                continue
            indices[one] = sobol_indices(table[one], groups, confidence=self.confidence, seed=self.seed)
        return SensitivityResult(
            self, family, table, tuple(names), indices, missing, asked.finish(), runner.computed, runner.seconds
        )


@dataclass(frozen=True)
class SensitivityResult(AbstractResult):
    """Shares of variances.

    - `study`, `family`: what was asked.
    - `table`: the rows.
    - `names`: of what has a share.
    - `indices`: of each result, by its key.
    - `missing`: results that some runs do not have, with how many these are; such have no indices.
    - `path`: of the table; None if it was not kept.
    - `computed`, `seconds`: rows that were not stored before, and the time that they took.
    """

    study: Sensitivity
    family: Family
    table: Columns
    names: tuple[str, ...]
    indices: dict[str, SobolIndices]
    missing: dict[str, int]
    path: Any
    computed: int
    seconds: float

    @property
    def runs(self) -> int:
        """How many there were."""
        return len(self.table["row"])

    @property
    def labels(self) -> tuple[str, ...]:
        """The names for a person."""
        return tuple(self.family.label(name) for name in self.names)

    @property
    def ended(self) -> str:
        """What there is."""
        without = [
            f"`{one}` is missing in {counted(count, 'run')} and has no indices" for one, count in self.missing.items()
        ]
        return "; ".join([all_done(self.runs), *without])

    @property
    def good(self) -> bool:
        """Whether no run failed."""
        return not np.any(self.table["outcome"] > 0)

    @property
    def lead(self) -> str:
        """The answer in a sentence."""
        said = [
            f"of `{of}` {self.labels[int(np.argmax(one.total))]} has {min(max(float(one.total.max()), 0.0), 1.0):.0%}"
            for of, one in self.indices.items()
            if one.variance > 0
        ]
        return f"{counted(self.runs, 'run')}: {'; '.join(said) or 'no result varies'} ({self.ended})."

    def sections(self) -> list[Section]:
        """The shares of each result."""
        from slidax.figures import variance_shares

        found = []
        for of, one in self.indices.items():
            rows: list[list[Cell]] = [
                [name, *(float(share[k]) for share in (one.first, one.first_half, one.total, one.total_half))]
                for k, name in enumerate(self.labels)
            ]
            drawing = variance_shares(self.labels, one.first, one.total, (one.first_half, one.total_half))
            note = f"Shares of the variance, with half the widths of their {self.study.confidence:.0%} intervals."
            picture = Drawn(f"shares-{of}", f"Shares of {of}", "By itself, and together with others.", drawing)
            head = ("Uncertain", "by itself", "±", "in all", "±")
            found.append(Section(f"What {of} depends on", note, head, rows, [picture]))
        return found

    def as_json(self) -> dict[str, Any]:
        """The result for a program."""
        return {
            "kind": "sensitivity",
            "runs": self.runs,
            "failures": int(np.sum(self.table["outcome"] > 0)),
            "probability": None,
            "ended": self.ended,
            "worst": worst_of(self.table),
            "indices": {one: self._said(one) for one in self.indices},
            "missing": self.missing,
        }

    def _said(self, of: str) -> list[dict[str, Any]]:
        one = self.indices[of]
        return [
            {
                "name": name,
                "first": float(one.first[k]),
                "first_half_width": float(one.first_half[k]),
                "total": float(one.total[k]),
                "total_half_width": float(one.total_half[k]),
            }
            for k, name in enumerate(self.names)
        ]
