"""Time that `ẋ = -f(x)` takes from one size to a smaller one."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from ..each import Floats

PIECES = 4000
"""Rectangles that bound an integral: the excess is below a hundredth for integrands of a few decades."""


def two_power_time(a: float, p: float, b: float, q: float, upper: float = math.inf, lower: float = 0.0) -> float:
    """Return `∫ dx/(a x^p + b x^q)` from `lower` to `upper`, s, for `p < 1 < q`: the time of `ẋ = -(a x^p + b x^q)`.

    With `m = (1-p)/(q-p)` and `y = (b/a) x^(q-p)` it is, from 0 to X,

        Γ(m) Γ(1-m) / (a (q-p)) · (a/b)^m · I_{y/(1+y)}(m, 1-m),

    I the regularised incomplete beta function, which is 1 for X = ∞: the supremum over all starts (R. Aldana-López,
    D. Gómez-Gutiérrez, E. Jiménez-Rodríguez, J. D. Sánchez-Torres, M. Defoort, International Journal of Robust and
    Nonlinear Control 29, 2019). A gain may be 0 if the integral is finite without its power.

    - `a`, `p`: gain and exponent near zero, p in [0, 1).
    - `b`, `q`: gain and exponent far from zero, q > 1.
    """
    if upper <= lower:
        return 0.0
    if b == 0.0:
        return math.inf if math.isinf(upper) else (upper ** (1 - p) - lower ** (1 - p)) / (a * (1 - p))
    if a == 0.0:
        return math.inf if lower == 0.0 else (lower ** (1 - q) - _power(upper, 1 - q)) / (b * (q - 1))
    from scipy.special import betainc

    m = (1.0 - p) / (q - p)
    whole = math.pi / math.sin(math.pi * m) / (a * (q - p)) * (a / b) ** m
    y_low = b / a * lower ** (q - p)
    if math.isinf(upper):
        # From the far end, to avoid the difference of nearly equal numbers.
        return float(whole * betainc(1.0 - m, m, 1.0 / (1.0 + y_low)))
    y = b / a * upper ** (q - p)
    if y_low > 1.0:
        return float(whole * (betainc(1.0 - m, m, 1.0 / (1.0 + y_low)) - betainc(1.0 - m, m, 1.0 / (1.0 + y))))
    return float(whole * (betainc(m, 1.0 - m, y / (1.0 + y)) - betainc(m, 1.0 - m, y_low / (1.0 + y_low))))


def bounded_time(pull: Callable[[Floats], Floats], upper: float, lower: float, weight: Any = None) -> float:
    """Return an upper bound of `∫ w(x) dx/f(x)` from `lower` to `upper`, for increasing f and w with known integral.

    The range is cut at equal ratios. In each piece f is at least its value at the lower end, so the piece adds at most
    `(W(x₁) - W(x₀))/f(x₀)`, with W the integral of w.

    - `pull`: f, increasing and > 0 on the range.
    - `upper`, `lower`: 0 < lower <= upper < ∞.
    - `weight`: W, increasing; None for `W(x) = x`.
    """
    if upper <= lower:
        return 0.0
    x = np.geomspace(lower, upper, PIECES + 1)
    grown = np.diff(x if weight is None else weight(x))
    return float(np.sum(grown / pull(x[:-1])))


def _power(x: float, exponent: float) -> float:
    return 0.0 if math.isinf(x) else x**exponent
