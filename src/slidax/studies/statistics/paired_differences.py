"""Paired differences of two schemes in a number such as the steady error."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import stats

from slidax._errors import DefinitionError, shown

from .interval import Interval, require_confidence

RESAMPLES = 9999
"""Of the bootstrap."""


@dataclass(frozen=True)
class PairedDifference:
    """The difference of two on the same cases.

    - `pairs`: in how many cases both have a number.
    - `mean`, `median`: of the differences; None without pairs.
    - `of_mean`: an interval by the bootstrap (BCa); None for fewer than two pairs.
    - `of_median`: an interval that holds for every distribution, from the order of the differences; likewise.
    - `p_value`: of Wilcoxon's signed-rank test that the differences are symmetric about 0; likewise.
    """

    pairs: int
    mean: float | None
    median: float | None
    of_mean: Interval | None
    of_median: Interval | None
    p_value: float | None

    @property
    def significant(self) -> bool:
        """True if the interval of the mean does not contain 0."""
        return self.of_mean is not None and 0.0 not in self.of_mean


def paired_difference(first: Any, second: Any, confidence: float = 0.95, *, seed: int = 0) -> PairedDifference:
    """`first - second`, case by case; cases in which one of them has no finite number are left out.

    - `first`, `second`: a number for each case [cases].
    - `confidence`: of the intervals.
    - `seed`: of the bootstrap.

    Raises DefinitionError if they have not the same cases, or the confidence is no share.
    """
    require_confidence(confidence)
    first, second = np.asarray(first, float), np.asarray(second, float)
    if first.shape != second.shape or first.ndim != 1:
        raise DefinitionError(
            f"both need one number for each case; got shapes {shown(first.shape)}, {shown(second.shape)}"
        )
    known = np.isfinite(first) & np.isfinite(second)
    d = first[known] - second[known]
    if d.size == 0:
        return PairedDifference(0, None, None, None, None, None)
    mean, median = float(d.mean()), float(np.median(d))
    if d.size == 1:
        return PairedDifference(1, mean, median, None, None, None)
    p_value = 1.0 if not d.any() else float(stats.wilcoxon(d).pvalue)
    return PairedDifference(d.size, mean, median, _of_mean(d, confidence, seed), _of_median(d, confidence), p_value)


def _of_mean(d: np.ndarray, confidence: float, seed: int) -> Interval:
    """Bias-corrected and accelerated (B. Efron, JASA 82, 1987)."""
    if np.all(d == d[0]):
        return Interval(float(d[0]), float(d[0]), confidence)
    with warnings.catch_warnings(action="ignore"):
        result = stats.bootstrap(
            (d,),
            np.mean,
            n_resamples=RESAMPLES,
            batch=200,
            confidence_level=confidence,
            rng=np.random.default_rng(seed),
        ).confidence_interval
    return Interval(float(result.low), float(result.high), confidence)


def _of_median(d: np.ndarray, confidence: float) -> Interval | None:
    result = stats.quantile_test(d, p=0.5).confidence_interval(confidence)
    return Interval(float(result.low), float(result.high), confidence) if np.isfinite([*result]).all() else None
