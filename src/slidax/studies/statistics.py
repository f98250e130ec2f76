"""Confidence intervals, confidence sequences, and paired tests."""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from scipy import stats
from scipy.optimize import brentq
from scipy.special import betaln, xlog1py, xlogy

from slidax.core.errors import DefinitionError, short_repr


@dataclass(frozen=True)
class Interval:
    """Confidence interval.

    - `lower`, `upper`: the ends.
    - `confidence`: coverage probability, in (0, 1).
    """

    lower: float
    upper: float
    confidence: float

    def __contains__(self, value: float) -> bool:
        return self.lower <= value <= self.upper


def require_confidence(confidence: Any) -> None:
    """Raise DefinitionError unless a confidence is in (0, 1)."""
    if not 0.0 < confidence < 1.0:
        raise DefinitionError(f"`confidence` must be in (0, 1), such as 0.95; got {short_repr(confidence)}")


def require_counts(failures: int, runs: int) -> None:
    """Raise DefinitionError unless `0 <= failures <= runs`."""
    if not 0 <= failures <= runs:
        raise DefinitionError(f"`failures` must be in [0, runs]; got {short_repr(failures)} of {short_repr(runs)} runs")


RESAMPLES = 9999
"""Number of bootstrap resamples."""


@dataclass(frozen=True)
class PairedDifference:
    """Difference of a quantity between two groups, first minus second, on the same cases.

    - `pairs`: number of cases with a value in both groups.
    - `mean`, `median`: mean and median difference; None without pairs.
    - `of_mean`: confidence interval of the mean by the bootstrap (BCa); None for fewer than two pairs.
    - `of_median`: distribution-free interval of the median, from order statistics; None for too few pairs.
    - `p_value`: p-value of Wilcoxon's signed-rank test of symmetry about 0; None for fewer than two pairs.
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
    """Return statistics of `first - second`, case by case; cases without two finite values are left out.

    - `first`, `second`: a value for each case [cases].
    - `confidence`: confidence of the intervals.
    - `seed`: seed of the bootstrap.

    Raises DefinitionError if the shapes differ, or the confidence is not in (0, 1).
    """
    require_confidence(confidence)
    first, second = np.asarray(first, float), np.asarray(second, float)
    if first.shape != second.shape or first.ndim != 1:
        raise DefinitionError(
            "`first` and `second` must have one value per case; got shapes "
            f"{short_repr(first.shape)}, {short_repr(second.shape)}"
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
    """Bias-corrected and accelerated bootstrap interval (B. Efron, JASA 82, 1987)."""
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


@dataclass(frozen=True)
class PairedShares:
    """Difference between the shares of cases with a property in two groups, on the same cases.

    - `pairs`: number of cases.
    - `only_one`, `only_other`: number of cases with the property only in the first group, and only in the second.
    - `difference`: first share minus second share.
    - `interval`: interval of the difference; None without cases.
    - `p_value`: p-value of McNemar's exact test (Psychometrika 12, 1947) of equal shares; 1 if no case differs.
    """

    pairs: int
    only_one: int
    only_other: int
    difference: float
    interval: Interval | None
    p_value: float


def paired_shares(first: Any, second: Any, confidence: float = 0.95) -> PairedShares:
    """Return statistics of the difference, first minus second, between two groups' shares of cases with a property.

    The interval is that of D. G. Bonett and R. M. Price (J. Educ. Behav. Stat. 37, 2012), for n cases, of which b
    have the property only in the first group and c only in the second, and the normal quantile z of (1 + confidence)/2:

        p₁ = (b + 1)/(n + 2),  p₂ = (c + 1)/(n + 2),  p₁ - p₂ ± z √((p₁ + p₂ - (p₁ - p₂)²)/(n + 2))

    - `first`, `second`: True for each case with the property in this group [cases].
    - `confidence`: confidence of the interval.

    Raises DefinitionError if the shapes differ, or the confidence is not in (0, 1).
    """
    require_confidence(confidence)
    first, second = np.asarray(first, bool), np.asarray(second, bool)
    if first.shape != second.shape or first.ndim != 1:
        raise DefinitionError(
            "`first` and `second` must have one bool per case; got shapes "
            f"{short_repr(first.shape)}, {short_repr(second.shape)}"
        )
    n, b, c = first.size, int(np.sum(first & ~second)), int(np.sum(second & ~first))
    if n == 0:
        return PairedShares(0, 0, 0, 0.0, None, 1.0)
    p_value = float(stats.binomtest(b, b + c, 0.5).pvalue) if b + c else 1.0
    p1, p2 = (b + 1) / (n + 2), (c + 1) / (n + 2)
    half = float(stats.norm.isf((1.0 - confidence) / 2.0)) * math.sqrt((p1 + p2 - (p1 - p2) ** 2) / (n + 2))
    interval = Interval(max(-1.0, p1 - p2 - half), min(1.0, p1 - p2 + half), confidence)
    return PairedShares(n, b, c, (b - c) / n, interval, p_value)


def clopper_pearson(
    failures: int, runs: int, confidence: float = 0.95, side: Literal["both", "upper"] = "both"
) -> Interval:
    """Return the exact confidence interval of the failure rate p for k failures in n runs.

    X is the number of failures in n runs with the failure rate p:

        Pr(X <= k | p = upper) = α/2,   Pr(X >= k | p = lower) = α/2,   α = 1 - confidence

    (C. J. Clopper, E. S. Pearson, Biometrika 26, 1934). For `side="upper"` the upper end uses all of α. The number of
    runs must not depend on their results; otherwise use `confidence_sequence`.

    - `failures`: k.
    - `runs`: n; the interval is [0, 1] for n = 0.
    - `confidence`: 1 - α.
    - `side`: "both" for two ends, "upper" to bound the rate only from above.

    Raises DefinitionError if k is not in [0, n], or the confidence is not in (0, 1).
    """
    require_counts(failures, runs)
    require_confidence(confidence)
    if side not in ("both", "upper"):
        raise DefinitionError(f"`side` must be `both` or `upper`; got {short_repr(side)}")
    tail = (1.0 - confidence) / (2.0 if side == "both" else 1.0)
    lower = 0.0 if failures == 0 or side == "upper" else float(stats.beta.ppf(tail, failures, runs - failures + 1))
    upper = 1.0 if failures == runs else float(stats.beta.isf(tail, failures + 1, runs - failures))
    return Interval(lower, upper, confidence)


NEVER = 0.5
"""Weight of the rate p = 0 in the mixture; the rest is a beta distribution."""

SHAPE = 0.2
"""Both parameters a of the beta distribution: below 1/2, which favours rare failures and rare successes."""

SMALLEST, LARGEST = 1e-300, 1.0 - 2.0**-53
"""Rates that are neither 0 nor 1."""


def confidence_sequence(failures: int, runs: int, confidence: float = 0.95) -> Interval:
    """Return an anytime-valid interval of the failure rate p: the study may stop after any run, by the results so far.

        Lₙ(p) = pᵏ (1 - p)ⁿ⁻ᵏ
        Mₙ(p) = (w 1[k = 0] + (1 - w) B(k + a, n - k + a) / B(a, a)) / Lₙ(p)

    with k failures in n runs, the beta function B, a = 0.2, w = 1/2, and 1[k = 0] equal to 1 without failures, else 0.
    For the true rate p, Mₙ(p) is a martingale with mean 1. By Ville's inequality it ever reaches 1/α with probability
    at most α. The interval is `{p: Mₙ(p) < 1/α}` (mixture method: H. Robbins, Ann. Math. Statist. 41, 1970). With the
    weight w = 1/2 on p = 0, the upper end without failures is slightly below that of `clopper_pearson` at the same n
    and confidence. With failures the interval is wider: at 99 % and n = 1000 the upper end is 1.5 times as high as
    Clopper and Pearson's for one to three failures, 1.26 times for 30, and 1.05 times for 500.

    - `failures`: k, so far.
    - `runs`: n, so far; the interval is [0, 1] for n = 0.
    - `confidence`: 1 - α, for all n together.

    Raises DefinitionError if k is not in [0, n], or the confidence is not in (0, 1).
    """
    require_counts(failures, runs)
    require_confidence(confidence)
    if runs == 0:
        return Interval(0.0, 1.0, confidence)
    threshold = -math.log1p(-confidence)

    def beyond(p: float) -> float:
        return float(log_evidence(failures, runs, p)) - threshold

    observed = failures / runs
    lower = 0.0 if failures == 0 else float(brentq(beyond, SMALLEST, observed, xtol=SMALLEST))
    upper = 1.0 if failures == runs else float(brentq(beyond, max(observed, SMALLEST), LARGEST, xtol=1e-15))
    return Interval(lower, upper, confidence)


def log_evidence(failures: Any, runs: Any, p: Any) -> np.ndarray:
    """Return `log Mₙ(p)` of `confidence_sequence`: the larger, the stronger the evidence against the failure rate p.

    - `failures`: k, a number or an array.
    - `runs`: n, a number or an array.
    - `p`: the rate, in (0, 1).
    """
    k, n = np.asarray(failures, float), np.asarray(runs, float)
    beta = math.log1p(-NEVER) + betaln(k + SHAPE, n - k + SHAPE) - betaln(SHAPE, SHAPE)
    mixture = np.logaddexp(beta, np.where(k == 0, math.log(NEVER), -np.inf))
    return np.asarray(mixture - xlogy(k, p) - xlog1py(n - k, -np.asarray(p, float)))
