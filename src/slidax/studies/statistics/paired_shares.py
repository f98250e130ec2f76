"""Paired shares: compares failure rates of two schemes on the same cases."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import stats

from slidax._errors import DefinitionError, shown

from .interval import Interval, require_confidence


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
            f"both need one answer for each case; got shapes {shown(first.shape)}, {shown(second.shape)}"
        )
    n, b, c = first.size, int(np.sum(first & ~second)), int(np.sum(second & ~first))
    if n == 0:
        return PairedShares(0, 0, 0, 0.0, None, 1.0)
    p_value = float(stats.binomtest(b, b + c, 0.5).pvalue) if b + c else 1.0
    p1, p2 = (b + 1) / (n + 2), (c + 1) / (n + 2)
    half = float(stats.norm.isf((1.0 - confidence) / 2.0)) * math.sqrt((p1 + p2 - (p1 - p2) ** 2) / (n + 2))
    interval = Interval(max(-1.0, p1 - p2 - half), min(1.0, p1 - p2 + half), confidence)
    return PairedShares(n, b, c, (b - c) / n, interval, p_value)
