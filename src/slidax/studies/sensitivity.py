"""Sobol indices of uncertain values."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from pydantic import Field

from slidax._errors import DefinitionError, counted, nearest, plain
from slidax.scenarios.base import said

from .asked import Asked
from .result import AbstractTableResult, Cell, Drawn, Section, all_done, worst_of
from .search.sobol_indices import SobolIndices, points_for_indices, sobol_indices
from .study import AbstractStudy, How

OF = ("margin", "steady_error", "max_torque_step")


class Sensitivity(AbstractStudy):
    """Sobol indices: the share of a result's variance that is due to each uncertain value.

    `first` is the effect of a value alone, `total` includes its interactions with others.
    """

    in_parts: ClassVar[bool] = True
    study: Literal["sensitivity"]
    base: Annotated[int, Field(ge=2, le=2**24)] = 256
    """A power of two; the study needs this times (number of shares + 2) runs."""
    of: Annotated[tuple[str, ...], Field(min_length=1)] = OF
    """Results: `margin`, or metrics such as `steady_error`."""
    each: Literal["path", "number"] = "path"
    """`path`: all values of a path, such as the friction of all joints, have one share; `number`: each has its own."""
    confidence: float = said("of the intervals", "", "(0, 1)", default=0.95)

    def run(self, how: How) -> SensitivityResult:
        family = self.family()
        space = family.space
        self.require(
            bool(space.sets),
            "uncertainty",
            "is empty: there is nothing that could have a share; give sets of uncertain values",
        )
        self.require(self.base & (self.base - 1) == 0, "base", f"must be a power of two, such as 256; got {self.base}")
        names = list(space.widths) if self.each == "path" else space.coordinates
        groups = list(space.widths.values()) if self.each == "path" else [1] * space.dimensions
        cube = points_for_indices(groups, self.base, seed=self.seed)
        evaluated = Asked(self.runner(family, how), family)
        how.begin(len(cube))
        table = evaluated.points(cube)
        indices, missing = {}, {}
        for key in self.of:
            if key not in table:
                raise DefinitionError(f"there is no metric `{plain(key)}`; {nearest(key, table)}", where="of")
            wrong = int(np.sum(~np.isfinite(table[key])))
            if wrong:
                missing[key] = wrong
                continue
            indices[key] = sobol_indices(table[key], groups, confidence=self.confidence, seed=self.seed)
        return SensitivityResult(
            study=self, **evaluated.collected(), names=tuple(names), indices=indices, missing=missing
        )


@dataclass(frozen=True)
class SensitivityResult(AbstractTableResult):
    """Shares of variances.

    - `names`: paths or numbers with a share; `indices`: by the key of the result.
    - `missing`: results without indices, and the number of runs that lack them.
    """

    study: Sensitivity
    names: tuple[str, ...]
    indices: dict[str, SobolIndices]
    missing: dict[str, int]

    @property
    def labels(self) -> tuple[str, ...]:
        """The names for a person."""
        return tuple(self.family.label(name) for name in self.names)

    @property
    def ended(self) -> str:
        """State of the rows."""
        without = [
            f"`{key}` is missing in {counted(count, 'run')} and has no indices" for key, count in self.missing.items()
        ]
        return "; ".join([all_done(self.runs), *without])

    @property
    def lead(self) -> str:
        shares = [
            f"of `{of}` {self.labels[int(np.argmax(own.total))]} has {min(max(float(own.total.max()), 0.0), 1.0):.0%}"
            for of, own in self.indices.items()
            if own.variance > 0
        ]
        return f"{counted(self.runs, 'run')}: {'; '.join(shares) or 'no result varies'} ({self.ended})."

    def sections(self) -> list[Section]:
        parts = []
        for of, own in self.indices.items():
            rows: list[list[Cell]] = [
                [name, *(float(share[k]) for share in (own.first, own.first_half, own.total, own.total_half))]
                for k, name in enumerate(self.labels)
            ]
            values = (self.labels, own.first, own.total, (own.first_half, own.total_half))
            note = f"Shares of the variance, with half the widths of their {self.study.confidence:.0%} intervals."
            chart = Drawn(
                f"shares-{of}", f"Shares of {of}", "By itself, and together with others.", "variance_shares", values
            )
            head = ("Uncertain", "by itself", "±", "in all", "±")
            parts.append(Section(f"Dependence of {of}", note, head, rows, [chart]))
        return parts

    def as_json(self) -> dict[str, Any]:
        return {
            "kind": "sensitivity",
            "runs": self.runs,
            "failures": self.failures,
            "probability": None,
            "ended": self.ended,
            "worst": worst_of(self.table),
            "indices": {of: self._shares(of) for of in self.indices},
            "missing": self.missing,
        }

    def _shares(self, of: str) -> list[dict[str, Any]]:
        own = self.indices[of]
        return [
            {
                "name": name,
                "first": float(own.first[k]),
                "first_half_width": float(own.first_half[k]),
                "total": float(own.total[k]),
                "total_half_width": float(own.total_half[k]),
            }
            for k, name in enumerate(self.names)
        ]
