"""`sinh`, `cosh` and `tanh`."""

from __future__ import annotations

import sys

from .exponential import half_expm1
from .expression import Expression


def sinh(x: Expression) -> Expression:
    """`H + H/(2H + 1)` with `H = (e^|x| - 1)/2`, and the sign of x."""
    half = half_expm1(abs(x))
    # The limit avoids the quotient of two infinities.
    return (half + half / (half + half + 1.0).at_most(sys.float_info.max)).signed_as(x)


def cosh(x: Expression) -> Expression:
    """`H + 1/2 + 1/(4H + 2)` with `H = (e^|x| - 1)/2`."""
    half = half_expm1(abs(x))
    return (half + 0.5) + 0.5 / (half + half + 1.0)


def tanh(x: Expression) -> Expression:
    """`H/(H + 1)` with `H = (e^(2|x|) - 1)/2`, and the sign of x."""
    # Beyond 40, tanh rounds to 1.
    magnitude = abs(x).at_most(40.0)
    half = half_expm1(magnitude + magnitude)
    return (half / (half + 1.0)).signed_as(x)
