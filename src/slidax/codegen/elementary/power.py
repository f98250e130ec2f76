"""`pow`."""

from __future__ import annotations

import math

from slidax.codegen.ir import Value

from .exponential import INTEGER, powers_of_two
from .expression import SIGN, Expression, fma, polynomial, select
from .logarithm import log2_in_two_parts

_LN2 = 0.6931471805599453

# (2^r - 1 - r ln 2)/r² for |r| <= 1/2, minimax; relative error of 2^r 2^-57.
_TAIL = (
    0.24022650695910108,
    0.05550410866482172,
    0.009618129107601592,
    0.0013333558146545958,
    0.00015403530449065452,
    1.5252733634618318e-05,
    1.3215438815814555e-06,
    1.0178159671340817e-07,
    7.073237345358792e-09,
    4.4389330007547364e-10,
)


def power(x: Expression, y: Expression) -> Expression:
    """`x^y = 2^(y log2 |x|)`, with the sign of x if y is odd, NaN for x < 0 if y is not an integer."""
    if _known_not_negative(x.value):
        return _of_magnitude(x, y)
    magnitude = _of_magnitude(abs(x), y)
    half = y * 0.5
    odd = half.rounded().differs(half) & y.rounded().equals(y)
    sign = select(odd, x.bits() & SIGN, 0)
    undefined = (x < 0.0) & (x > float("-inf")) & y.rounded().differs(y)
    return select(undefined, float("nan"), magnitude.flipped(sign))


def _of_magnitude(x: Expression, y: Expression) -> Expression:
    """`x^y` for x >= 0."""
    high, low = log2_in_two_parts(x)
    product = y * high
    # The limit replaces NaN, where the product is infinite or NaN.
    rest = fma(y, low, fma(y, high, -product)).within(1.0)
    product = product.at_most(1100.0).at_least(-1100.0)
    shifted = product + INTEGER
    r = (product - (shifted - INTEGER)) + rest
    q = fma(r, _LN2, r * r * polynomial(r, _TAIL))
    a, b = powers_of_two(shifted)
    result = fma(a, q, a) * b
    if y.value.op == "const" and y.value.data != 0.0 and abs(y.value.data) < float("inf"):
        return result
    return select(x.equals(1.0) | y.equals(0.0), 1.0, result)


def _known_not_negative(x: Value) -> bool:
    if x.op == "const":
        return math.copysign(1.0, x.data) > 0.0
    if x.op == "mul":
        return x.args[0] is x.args[1]
    if x.op in ("max", "select"):
        numbers = x.args[-2:]
        known = [_known_not_negative(number) for number in numbers]
        return all(known) if x.op == "select" else any(known)
    return x.op in ("abs", "exp")
