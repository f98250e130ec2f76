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
        raise DefinitionError(f"`confidence` must be in (0, 1), as 0.95; got {short_repr(confidence)}")


def require_counts(failures: int, runs: int) -> None:
    """Raises DefinitionError unless so many runs can have failed.

    - `failures`: how many failed.
    - `runs`: of how many.
    """
    if not 0 <= failures <= runs:
        raise DefinitionError(f"`failures` must be in [0, runs]; got {short_repr(failures)} of {short_repr(runs)} runs")


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
            f"both need one number for each case; got shapes {short_repr(first.shape)}, {short_repr(second.shape)}"
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


@dataclass(frozen=True)
class PairedShares:
    """Two shares of the same cases.

    - `pairs`: how many cases.
    - `only_one`, `only_other`: in how many of them it is true of one and not of the other.
    - `difference`: the share of one less that of the other.
    - `interval`: of the difference; None without cases.
    - `p_value`: of the exact test by McNemar (Psychometrika 12, 1947) that both are the same; 1 if they never differ.
    """

    pairs: int
    only_one: int
    only_other: int
    difference: float
    interval: Interval | None
    p_value: float


def paired_shares(first: Any, second: Any, confidence: float = 0.95) -> PairedShares:
    """In what share of the cases something is true of the first, less the share of the second.

    The interval is that of D. G. Bonett and R. M. Price (J. Educ. Behav. Stat. 37, 2012), with b, c the cases in which
    only one has it:

        p₁ = (b + 1)/(n + 2),  p₂ = (c + 1)/(n + 2),  p₁ - p₂ ± z √((p₁ + p₂ - (p₁ - p₂)²)/(n + 2))

    - `first`, `second`: a bool for each case [cases].
    - `confidence`: of the interval.

    Raises DefinitionError if they have not the same cases, or the confidence is no share.
    """
    require_confidence(confidence)
    first, second = np.asarray(first, bool), np.asarray(second, bool)
    if first.shape != second.shape or first.ndim != 1:
        raise DefinitionError(
            f"both need one answer for each case; got shapes {short_repr(first.shape)}, {short_repr(second.shape)}"
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
    """The rate p at which runs fail, by an interval that holds for every p as often as it says.

    With k of n failed,

        Pr(X <= k | p = upper) = α/2,   Pr(X >= k | p = lower) = α/2,   α = 1 - confidence

    (C. J. Clopper, E. S. Pearson, Biometrika 26, 1934), where all of α goes to the upper end if that alone is asked
    for. The number of runs must not depend on how they went; else `confidence_sequence` is the one.

    - `failures`: k.
    - `runs`: n; of none nothing is known, [0, 1].
    - `confidence`: 1 - α.
    - `side`: "upper" bounds the rate from above only.

    Raises DefinitionError if so many cannot have failed, or the confidence is no share.
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
"""The weight of "it never fails" in the mixture; the rest is a beta distribution."""

SHAPE = 0.2
"""Both parameters of that distribution: below 1/2, so that rare failures and rare successes are near to it."""

SMALLEST, LARGEST = 1e-300, 1.0 - 2.0**-53
"""Rates that are neither 0 nor 1."""


def confidence_sequence(failures: int, runs: int, confidence: float = 0.95) -> Interval:
    """All rates p for which the runs so far are no wonder; whoever looks after each run may stop when he likes.

        Lₙ(p) = pᵏ (1 - p)ⁿ⁻ᵏ
        Mₙ(p) = (w 1[k = 0] + (1 - w) B(k + a, n - k + a) / B(a, a)) / Lₙ(p)

    is a martingale with mean 1 if p is the rate, so that by Ville's inequality it ever reaches 1/α with a probability
    of α at most; the interval is `{p: Mₙ(p) < 1/α}` (the mixture method: H. Robbins, Ann. Math. Statist. 41, 1970).
    The weight w = 1/2 on p = 0 makes it sharp where nothing fails: its upper end is then that of `clopper_pearson`
    at the same n and confidence, whose two tails cost the same factor of two. After failures it is the wider one: at
    99 % and n = 1000 its upper end is 1.5 times as high with one to three of them, 1.26 times with 30, 1.05 with 500.

    - `failures`: k, up to now.
    - `runs`: n, up to now; of none nothing is known, [0, 1].
    - `confidence`: 1 - α, for all n together.

    Raises DefinitionError if so many cannot have failed, or the confidence is no share.
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
    """`log Mₙ(p)`: how much the runs speak against the rate p; its exponent ever reaches 1/α with probability <= α.

    - `failures`: k, a number or an array.
    - `runs`: n, likewise.
    - `p`: the rate, in (0, 1).
    """
    k, n = np.asarray(failures, float), np.asarray(runs, float)
    beta = math.log1p(-NEVER) + betaln(k + SHAPE, n - k + SHAPE) - betaln(SHAPE, SHAPE)
    mixture = np.logaddexp(beta, np.where(k == 0, math.log(NEVER), -np.inf))
    return np.asarray(mixture - xlogy(k, p) - xlog1py(n - k, -np.asarray(p, float)))
