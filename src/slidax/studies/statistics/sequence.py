"""Failure rate by an interval that holds at every number of runs at once."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from scipy.optimize import brentq
from scipy.special import betaln, xlog1py, xlogy

from .interval import Interval, require_confidence, require_counts

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
