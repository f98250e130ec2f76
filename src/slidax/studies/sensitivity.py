"""Sobol indices: the share of a result's variance due to each uncertain value."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from pydantic import Field

from slidax.core.errors import DefinitionError, count_noun, percent, short_repr
from slidax.scenarios.descriptions import input_field

from .cases import require_metric
from .runner import BatchEvaluator
from .study import AbstractStudy, AbstractTableResult, Cell, Chart, RunOptions, Section, all_done, worst_row


@dataclass(frozen=True)
class SobolIndices:
    """Sobol indices of one scalar result of the runs (I. M. Sobol', Math. Comput. Simul. 55, 2001).

    - `first`: first-order index of each group of values, for its effect alone [groups].
    - `total`: total index of each group, including interactions with other groups [groups].
    - `first_half`, `total_half`: half widths of their intervals [groups].
    - `confidence`: confidence of the intervals.
    - `variance`: variance of the result; if it is 0, all indices are 0.
    """

    first: np.ndarray
    total: np.ndarray
    first_half: np.ndarray
    total_half: np.ndarray
    confidence: float
    variance: float


def points_for_indices(groups: Sequence[int], base: int, *, seed: int = 0) -> np.ndarray:
    """Return the points at which Sobol indices need a result, by Saltelli's scheme [base (groups + 2), dimension].

    The points are in the unit cube, whose dimension is the sum of the groups.

    - `groups`: number of coordinates in each group; a group gets one first-order and one total index.
    - `base`: a power of two, at least a few hundred.
    - `seed`: seed of the scrambling.

    Raises DefinitionError if the base is not a power of two, or SALib is not installed.
    """
    if base < 2 or base & (base - 1):
        raise DefinitionError(f"`base` must be a power of two, such as 512; got {short_repr(base)}")
    salib = _salib()
    return salib[0].sample(_problem(groups), base, calc_second_order=False, scramble=True, seed=seed)


def sobol_indices(
    results: np.ndarray, groups: Sequence[int], *, confidence: float = 0.95, seed: int = 0
) -> SobolIndices:
    """Return the Sobol indices of a result, by SALib, with confidence intervals from 100 resamples.

    - `results`: the result at each of the `points_for_indices`, in their order [base (groups + 2)].
    - `groups`: as in `points_for_indices`.
    - `seed`: seed of the resampling.

    Raises DefinitionError if a result is missing or not finite, or SALib is not installed.
    """
    results = np.asarray(results, float)
    if results.ndim != 1 or len(results) % (len(groups) + 2):
        raise DefinitionError(
            f"`results` must have a value for each point of `points_for_indices`; got shape {short_repr(results.shape)}"
        )
    wrong = int(np.sum(~np.isfinite(results)))
    if wrong:
        raise DefinitionError(f"{wrong} of {len(results)} results are not finite: Sobol indices need all results")
    if np.ptp(results) == 0.0:
        nothing = np.zeros(len(groups))
        return SobolIndices(nothing, nothing, nothing, nothing, confidence, 0.0)
    # With seed 0, SALib uses NumPy's global random numbers.
    result = _salib()[1].analyze(
        _problem(groups), results, calc_second_order=False, conf_level=confidence, seed=seed + 1
    )
    first, total, first_half, total_half = (np.asarray(result[key]) for key in ("S1", "ST", "S1_conf", "ST_conf"))
    return SobolIndices(first, total, first_half, total_half, confidence, float(results.var()))


def _problem(groups: Sequence[int]) -> dict[str, Any]:
    """SALib's problem definition; the coordinates of a group are resampled together."""
    dimension = sum(groups)
    result: dict[str, Any] = {
        "num_vars": dimension,
        "names": [f"x{k}" for k in range(dimension)],
        "bounds": [[0.0, 1.0]] * dimension,
    }
    if dimension > len(groups):
        result["groups"] = [f"group {k}" for k, width in enumerate(groups) for _ in range(width)]
    return result


def _salib() -> tuple[Any, Any]:
    try:
        from SALib.analyze import sobol as analyze
        from SALib.sample import sobol as sample
    except ImportError:
        raise DefinitionError(
            "Sobol indices need SALib, which is not installed: pip install 'slidax[studies]'"
        ) from None
    return sample, analyze


OF = ("margin", "steady_error", "max_torque_step")


class Sensitivity(AbstractStudy):
    """Sobol indices: the share of a result's variance due to each uncertain value, alone and with interactions."""

    in_parts: ClassVar[bool] = True
    study: Literal["sensitivity"]
    base: Annotated[int, Field(ge=2, le=2**24)] = 256
    """Base of the sample size, a power of two: the study needs `base` times (number of shares + 2) runs."""
    of: Annotated[tuple[str, ...], Field(min_length=1)] = OF
    """Results whose variance is explained: `margin`, or metrics such as `steady_error`."""
    each: Literal["path", "number"] = "path"
    """`path`: a share for each path, such as the friction of all joints; `number`: a share for each number in it."""
    confidence: float = input_field("confidence of the intervals", "", "(0, 1)", default=0.95)

    def run(self, how: RunOptions) -> SensitivityResult:
        family = self.family()
        space = family.space
        self.require(
            bool(space.sets),
            "uncertainty",
            "is empty: there is no value to compute an index for; give sets of uncertain values",
        )
        self.require(self.base & (self.base - 1) == 0, "base", f"must be a power of two, such as 256; got {self.base}")
        names = list(space.widths) if self.each == "path" else space.coordinates
        groups = list(space.widths.values()) if self.each == "path" else [1] * space.dimensions
        cube = points_for_indices(groups, self.base, seed=self.seed)
        evaluated = BatchEvaluator(self.runner(family, how), family)
        how.begin(len(cube))
        table = evaluated.points(cube)
        indices, missing = {}, {}
        for key in self.of:
            require_metric(key, table, "of")
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
    """Result of a sensitivity study.

    - `names`: names of the groups of values: paths, or numbers such as `robot.plant.coulomb[0]`.
    - `indices`: Sobol indices by result, in the order of `names`.
    - `missing`: for results without indices, the number of runs that lack the result.
    """

    study: Sensitivity
    names: tuple[str, ...]
    indices: dict[str, SobolIndices]
    missing: dict[str, int]

    @property
    def labels(self) -> tuple[str, ...]:
        """Short labels of `names`."""
        return tuple(self.family.label(name) for name in self.names)

    @property
    def ended(self) -> str:
        """Sentence that all runs are done, and which results have no indices."""
        without = [
            f"`{key}` is missing in {count_noun(count, 'run')} and has no indices"
            for key, count in self.missing.items()
        ]
        return "; ".join([all_done(self.runs), *without])

    @property
    def summary(self) -> str:
        shares = [
            f"{self.labels[int(np.argmax(own.total))]} accounts for "
            f"{percent(min(max(float(own.total.max()), 0.0), 1.0))} of the variance of `{of}`"
            for of, own in self.indices.items()
            if own.variance > 0
        ]
        return f"{count_noun(self.runs, 'run')}: {'; '.join(shares) or 'no result varies'} ({self.ended})."

    def sections(self) -> list[Section]:
        parts = []
        for of, own in self.indices.items():
            rows: list[list[Cell]] = [
                [name, *(float(share[k]) for share in (own.first, own.first_half, own.total, own.total_half))]
                for k, name in enumerate(self.labels)
            ]
            values = (self.labels, own.first, own.total, (own.first_half, own.total_half))
            note = f"Shares of the variance, with the half widths of their {percent(self.study.confidence)} intervals."
            chart = Chart(f"shares-{of}", f"Shares of {of}", "Alone, and with interactions.", "variance_shares", values)
            head = ("Uncertain value", "Alone", "±", "With interactions", "±")
            parts.append(Section(f"Dependence of {of}", note, head, rows, [chart]))
        return parts

    def as_json(self) -> dict[str, Any]:
        return {
            "kind": "sensitivity",
            "runs": self.runs,
            "failures": self.failures,
            "probability": None,
            "ended": self.ended,
            "worst": worst_row(self.table),
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
