"""`log`, `log1p`, and the logarithm to base 2 in two parts, for powers."""

from __future__ import annotations

from .expression import Expression, fma, polynomial, select

SMALLEST_NORMAL = 2.0**-1022

# Bits of sqrt(1/2): mantissas are between it and sqrt(2).
_ROOT_HALF = 0x3FE6A09E667F3BCD
_ONE = 0x3FF0000000000000
_MANTISSA = 0x000FFFFFFFFFFFFF
# Bits of 2^52: added to an integer, they are the bits of a f64 with that integer in the lowest bits.
_INTEGER = 0x4330000000000000

_LN2_HIGH = float.fromhex("0x1.62e42fefa39efp-1")
_LN2_LOW = float.fromhex("0x1.abc9e3b39803fp-56")
# 2/(3 ln 2) in two parts.
_SCALE_HIGH = float.fromhex("0x1.ec709dc3a03fdp-1")
_SCALE_LOW = float.fromhex("0x1.d27f05548af0cp-55")

# (3 (artanh(s)/s - 1) - z)/z², z = s², for |s| <= (sqrt(2) - 1)/(sqrt(2) + 1), minimax; relative error of artanh 2^-66.
_TAIL = (
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
    """`log(m) = 2 artanh(s) = 2/3 s (3 + z + z² W(z))`, s = (m - 1)/(m + 1), z = s².

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
        self.tail = self.z * self.z * polynomial(self.z, _TAIL)


def log(x: Expression) -> Expression:
    """`ln x`."""
    return _log(x, None)


def log1p(x: Expression) -> Expression:
    """`ln(1 + x) = ln u + c/u`, with u the rounded sum and c its error."""
    u = x + 1.0
    added = u - 1.0
    error = (1.0 - (u - added)) + (x - added)
    # The limit replaces the quotient's NaN at -1 and at infinity.
    result = _log(u, (error / u).within(2.0**-50))
    # Only a zero has the wrong sign before.
    return result.signed_as(x)


def _log(x: Expression, addend: Expression | None) -> Expression:
    """`ln x = e ln 2 + f - (f²/2 - s (f²/2 + 2/3 (z + z² W)))`, plus a small addend."""
    e, m = _split(x)
    e = select(x < 0.0, float("nan"), e)
    parts = _Artanh(m)
    half_square = parts.f * 0.5 * parts.f
    bracket = fma(parts.z + parts.tail, 2.0 / 3.0, half_square)
    small = e * _LN2_LOW if addend is None else fma(e, _LN2_LOW, addend)
    return fma(e, _LN2_HIGH, parts.f - (half_square - fma(parts.s, bracket, small)))


def log2_in_two_parts(x: Expression) -> tuple[Expression, Expression]:
    """`log2 x` for x >= 0 as a sum of two numbers, relative error 2^-63; the second is NaN where x is 0 or infinite."""
    e, m = _split(x)
    parts = _Artanh(m)
    s, z, d = parts.s, parts.z, parts.d
    # Rounding errors.
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
