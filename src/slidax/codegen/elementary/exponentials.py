"""Exponentials, logarithms, powers, roots and hyperbolic functions in correctly rounded operations."""

from __future__ import annotations

import math
import sys

from ..ir import Value
from .expression import SIGN, Expression, fma, polynomial, select

INTEGER = 1.5 * 2.0**52 + 2046.0
"""Constant that, added to a number, leaves the nearest integer plus 2046 (to make it positive) in the lowest bits."""

_LOG2_E = 1.4426950408889634
# ln 2 in two parts; the first has so few bits that its product with an exponent is exact.
_LN2_HIGH = float.fromhex("0x1.62e42fefa3800p-1")
_LN2_LOW = float.fromhex("0x1.ef35793c76730p-45")

# (e^r - 1 - r)/r² for |r| <= ln(2)/2, minimax; relative error of e^r 2^-57.
_EXP_TAIL = (
    0.5,
    0.16666666666666433,
    0.04166666666660392,
    0.008333333333500286,
    0.001388888892681153,
    0.00019841269466015836,
    2.4801508663177055e-05,
    2.755764082192272e-06,
    2.762519424892607e-07,
    2.4978449060777845e-08,
)


def powers_of_two(shifted: Expression) -> tuple[Expression, Expression]:
    """Return two powers of two whose product is `2^n`, for n from -2044 to 2046; a single f64 has a smaller range.

    - `shifted`: the sum n + `INTEGER` as f64; the integer n + 2046 is in its lowest bits.
    """
    bits = shifted.bits()
    half = bits >> 1
    return (half << 52).number(), ((bits - half) << 52).number()


def _parts(x: Expression) -> tuple[Expression, Expression, Expression]:
    """Return q, a and b with `e^x = (1 + q) a b`, q in (-0.3, 0.42), a and b powers of two.

    Cody and Waite's reduction `x = n ln 2 + r`, |r| <= ln(2)/2, q = e^r - 1.
    """
    x = x.at_most(711.0).at_least(-746.0)
    shifted = fma(x, _LOG2_E, INTEGER)
    n = shifted - INTEGER
    r = fma(n, -_LN2_LOW, fma(n, -_LN2_HIGH, x))
    q = fma(r * r, polynomial(r, _EXP_TAIL), r)
    return q, *powers_of_two(shifted)


def exp(x: Expression) -> Expression:
    """`e^x`."""
    q, a, b = _parts(x)
    return fma(a, q, a) * b


def half_expm1(x: Expression) -> Expression:
    """`(e^x - 1)/2 = (a q + (a - 1/b)) b/2`, with q, a, b as in `expm1`; no overflow where sinh x is finite."""
    q, a, b = _parts(x)
    return _less_one(q, a, b) * (b * 0.5)


def expm1(x: Expression) -> Expression:
    """`e^x - 1 = (a q + (a - 1/b)) b` with `e^x = (1 + q) a b`, where a and b are powers of two."""
    q, a, b = _parts(x)
    # This corrects the sign of a zero.
    return (_less_one(q, a, b) * b).signed_as(x)


def _less_one(q: Expression, a: Expression, b: Expression) -> Expression:
    """`(1 + q) a - 1/b`."""
    # Twice the bits of 1, minus the bits of a power of two, are the bits of its inverse.
    return fma(a, q, a - (0x7FE0000000000000 - b.bits()).number())


SMALLEST_NORMAL = 2.0**-1022

# Bits of sqrt(1/2): mantissas are between it and sqrt(2).
_ROOT_HALF = 0x3FE6A09E667F3BCD
_ONE = 0x3FF0000000000000
_MANTISSA = 0x000FFFFFFFFFFFFF
# Bits of 2^52: added to an integer, they are the bits of a f64 with that integer in the lowest bits.
_INTEGER = 0x4330000000000000

_LOG_LN2_HIGH = float.fromhex("0x1.62e42fefa39efp-1")
_LOG_LN2_LOW = float.fromhex("0x1.abc9e3b39803fp-56")
# 2/(3 ln 2) in two parts.
_SCALE_HIGH = float.fromhex("0x1.ec709dc3a03fdp-1")
_SCALE_LOW = float.fromhex("0x1.d27f05548af0cp-55")

# (3 (artanh(s)/s - 1) - z)/z², z = s², for |s| <= (sqrt(2) - 1)/(sqrt(2) + 1), minimax; relative error of artanh 2^-66.
_LOG_TAIL = (
    0.6000000000000338,
    0.42857142855147656,
    0.3333333378019308,
    0.27272676523222805,
    0.2308013728343024,
    0.1988519614660966,
    0.1979478069691141,
)


def _split(x: Expression) -> tuple[Expression, Expression]:
    """Exponent e and mantissa m of `x = 2^e m`, 1/2 <= m² < 2; e is inf or NaN where x is, and -inf for x = 0."""
    small = x < SMALLEST_NORMAL
    bits = select(small, x * 2.0**54, x).bits() + (_ONE - _ROOT_HALF)
    e = ((bits >> 52) | _INTEGER).number() - select(small, x.constant(2.0**52 + 1077.0), 2.0**52 + 1023.0)
    e = select(x < float("inf"), select(x.equals(0.0), float("-inf"), e), x)
    return e, ((bits & _MANTISSA) + _ROOT_HALF).number()


class _Artanh:
    """`ln m = 2 artanh(s) = 2/3 s (3 + z + z² W(z))`, s = (m - 1)/(m + 1), z = s².

    W is the polynomial with the coefficients `_LOG_TAIL`.

    - `f`: m - 1.
    - `d`, `reciprocal`: m + 1 rounded, and 1/d.
    - `s`, `z`, `tail`: s and z rounded, and z² W(z).
    """

    def __init__(self, m: Expression) -> None:
        self.m = m
        self.f = m - 1.0
        self.d = m + 1.0
        self.reciprocal = 1.0 / self.d
        self.s = self.f * self.reciprocal
        self.z = self.s * self.s
        self.tail = self.z * self.z * polynomial(self.z, _LOG_TAIL)


def log(x: Expression) -> Expression:
    """`ln x`."""
    return _log(x, None)


def log1p(x: Expression) -> Expression:
    """`ln(1 + x) = ln u + c/u`, where u is the rounded sum 1 + x, and c its rounding error."""
    u = x + 1.0
    added = u - 1.0
    error = (1.0 - (u - added)) + (x - added)
    # The limit replaces the quotient's NaN at -1 and at infinity.
    result = _log(u, (error / u).within(2.0**-50))
    # This corrects the sign of a zero.
    return result.signed_as(x)


def _log(x: Expression, addend: Expression | None) -> Expression:
    """`ln x = e ln 2 + f - (f²/2 - s (f²/2 + 2/3 (z + z² W)))`, plus a small addend.

    e is the exponent of x, from `_split`; f, s, z and W belong to the mantissa, as in `_Artanh`.
    """
    e, m = _split(x)
    e = select(x < 0.0, float("nan"), e)
    parts = _Artanh(m)
    half_square = parts.f * 0.5 * parts.f
    bracket = fma(parts.z + parts.tail, 2.0 / 3.0, half_square)
    small = e * _LOG_LN2_LOW if addend is None else fma(e, _LOG_LN2_LOW, addend)
    return fma(e, _LOG_LN2_HIGH, parts.f - (half_square - fma(parts.s, bracket, small)))


def log2_in_two_parts(x: Expression) -> tuple[Expression, Expression]:
    """Return two numbers whose sum is `log2 x`, for x >= 0, with a relative error of 2^-63.

    The second number is NaN if x is 0 or infinite.
    """
    e, m = _split(x)
    parts = _Artanh(m)
    s, z, d = parts.s, parts.z, parts.d
    # Names that end in `_low` are rounding errors of the value with the name before it.
    s_low = fma(-s, m - (d - 1.0), fma(-s, d, parts.f)) * parts.reciprocal
    z_low = fma(s + s, s_low, fma(s, s, -z))
    series = z + parts.tail
    series_low = ((z - series) + parts.tail) + z_low
    three = series + 3.0
    three_low = (series - (three - 3.0)) + series_low
    p = s * three
    p_low = fma(s_low, three, fma(s, three_low, fma(s, three, -p)))
    log2_m = p * _SCALE_HIGH
    low = fma(p, _SCALE_LOW, fma(p_low, _SCALE_HIGH, fma(p, _SCALE_HIGH, -log2_m)))
    high = e + log2_m
    return high, (log2_m - (high - e)) + low


_LN2 = 0.6931471805599453

# (2^r - 1 - r ln 2)/r² for |r| <= 1/2, minimax; relative error of 2^r 2^-57.
_POWER_TAIL = (
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
    """`x^y = 2^(y log2 |x|)`, with the sign of x if y is odd; NaN for finite x < 0 if y is not an integer."""
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
    q = fma(r, _LN2, r * r * polynomial(r, _POWER_TAIL))
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


# A constant minus a third of the upper bits of x approximates the upper bits of x^(-1/3). 2^52 + b has the integer b in
# its lowest bits.

_THIRD_OF_BITS = 6004800933347025.0

# ((1 - h)^(-1/3) - 1)/h for |h| < 0.103, relative error 2^-32.
_INVERSE = (
    0.3333333456155788,
    0.2222222550943691,
    0.1728299108205333,
    0.14401765283592136,
    0.12667543966570663,
    0.11308894513399043,
)


def cbrt(x: Expression) -> Expression:
    """The cube root of x: from `|x|^(-1/3)`, which needs no division, and one Newton step."""
    magnitude = abs(x)
    small = magnitude < SMALLEST_NORMAL
    a = select(small, magnitude * 2.0**54, magnitude)
    upper = ((a.bits() >> 32) | _INTEGER).number()
    guess = (fma(upper, -1.0 / 3.0, _THIRD_OF_BITS).bits() << 32).number()
    h = fma(a * guess, -(guess * guess), 1.0)
    inverse = fma(guess * h, polynomial(h, _INVERSE), guess)
    inverse_square = inverse * inverse
    root = a * inverse_square
    square = root * root
    excess = fma(fma(root, root, -square), root, fma(square, root, -a))
    root = fma(inverse_square * excess, -1.0 / 3.0, root)
    root = root * select(small, root.constant(2.0**-18), 1.0)
    # The formula is right for zero, but not for infinity and NaN.
    root = select(magnitude < float("inf"), root, magnitude)
    return root.signed_as(x)


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
