"""Failure rate from a number of runs that was fixed beforehand."""

from __future__ import annotations

import math
from typing import Literal

from scipy import stats

from slidax._errors import DefinitionError, shown

from .interval import Interval, require_confidence, require_counts


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
        raise DefinitionError(f"`side` must be `both` or `upper`; got {shown(side)}")
    tail = (1.0 - confidence) / (2.0 if side == "both" else 1.0)
    lower = 0.0 if failures == 0 or side == "upper" else float(stats.beta.ppf(tail, failures, runs - failures + 1))
    upper = 1.0 if failures == runs else float(stats.beta.isf(tail, failures + 1, runs - failures))
    return Interval(lower, upper, confidence)


def runs_without_failure(rate: float, confidence: float = 0.95) -> int:
    """Number of successive runs without failure that show that the rate is lower: the least n with `(1 - rate)ⁿ <= α`.

    To stop at the first failure is part of this test, so that no more is needed than for a fixed number.

    - `rate`: of failures, to be shown not to be reached, in (0, 1).
    - `confidence`: 1 - α.

    Raises DefinitionError if one of them is no share.
    """
    require_confidence(confidence)
    if not 0.0 < rate < 1.0:
        raise DefinitionError(f"`rate` must be in (0, 1); got {shown(rate)}")
    return math.ceil(math.log1p(-confidence) / math.log1p(-rate) - 1e-9)
