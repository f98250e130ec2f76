"""Exact reduction of huge angles to a quarter turn."""

from __future__ import annotations

from itertools import pairwise

from .expression import SIGN, Expression, fma, select

# pi/2 in two parts.
_PI_2_HIGH = float.fromhex("0x1.921fb54442d18p+0")
_PI_2_LOW = float.fromhex("0x1.1a62633145c07p-54")
_LOW_32 = 0xFFFFFFFF

# Binary digits of 2/pi, after 31 zeros.
_TWO_OVER_PI = (
    0x0000000145F306DC,
    0x9C882A53F84EAFA3,
    0xEA69BB81B6C52B32,
    0x78872083FCA2C757,
    0xBD778AC36E48DC74,
    0x849BA5C00C925DD4,
    0x13A32439FC3BD639,
    0x62534E7DD1046BEA,
    0x5D768909D338E04D,
    0x68BEFC827323AC73,
    0x06A673E93908BF17,
    0x7BF250763FF12FFF,
    0xBC0B301FDE5E2316,
    0xB414DA3EDA6CFD9E,
    0x4F96136E9E8C7ECD,
    0x3CBFD45AEA4F758F,
    0xD7CBE2F67A0E73EF,
    0x14A525D4D7F6BF62,
    0x3F1ABA10AC06608D,
)


def reduced(x: Expression) -> tuple[Expression, Expression, Expression]:
    """Three numbers: r, r' and n with `x = n pi/2 + r - r'`, |r| <= pi/4, r' a rounding error, n an u64 mod 4.

    Payne and Hanek's reduction: the mantissa is multiplied only by those digits of 2/pi that give neither whole turns
    nor fractions below 2^-117.

    - `x`: f64, 2^23 <= |x|; the result is NaN for infinities.
    """
    magnitude = abs(x).bits()
    mantissa = (magnitude & 0x000FFFFFFFFFFFFF) | 0x0010000000000000
    words = _digits((magnitude >> 52) - 1046)
    upper, lower = _product(mantissa, words)
    # Two bits of quarter turns, then the fraction, in two's complement after the rounding of n.
    high = (upper << 2) | (lower >> 62)
    low = lower << 2
    n = (upper >> 62) + (high >> 63)
    negative = (high >> 63).differs(0)
    high, low = select(negative, ~high, high), select(negative, ~low, low)
    first = (high >> 32).cast("convert", "f64") * 2.0**-32
    second = (high & _LOW_32).cast("convert", "f64") * 2.0**-64
    third = (low >> 11).cast("convert", "f64") * 2.0**-117
    top = first + second
    rest = (second - (top - first)) + third
    fraction = top + rest
    rest = rest - (fraction - top)
    r = fraction * _PI_2_HIGH
    error = fma(fraction, -_PI_2_LOW, fma(rest, -_PI_2_HIGH, -fma(fraction, _PI_2_HIGH, -r)))
    sign = (x.bits() ^ select(negative, n.constant(SIGN), 0)) & SIGN
    # x - x is NaN at infinity.
    return (
        r.flipped(sign) + (x - x),
        error.flipped(sign),
        select(x < 0.0, 0 - n, n),
    )


def _digits(first: Expression) -> tuple[Expression, Expression, Expression]:
    """192 digits of 2/pi after the first `first`, u64, less than 1024."""
    words = [first.constant(word) for word in _TWO_OVER_PI]
    for bit in (8, 4, 2, 1):
        skip = (first & (64 * bit)).differs(0)
        words = [select(skip, words[k + bit], words[k]) for k in range(bit + 3)]
    by = first & 63
    a, b, c = [(word << by) | ((following >> 1) >> (63 - by)) for word, following in pairwise(words)]
    return a, b, c


def _product(mantissa: Expression, words: tuple[Expression, Expression, Expression]) -> tuple[Expression, Expression]:
    """Upper 128 of the product's last 192 bits before the point, without a carry from the last word."""
    a, b, c = words
    lower = mantissa * b
    total = lower + _upper_half(mantissa, c)
    carry = select(total < lower, lower.constant(1), 0)
    return mantissa * a + _upper_half(mantissa, b) + carry, total


def _upper_half(x: Expression, y: Expression) -> Expression:
    """The upper 64 bits of a product of two u64."""
    x_high, x_low, y_high, y_low = x >> 32, x & _LOW_32, y >> 32, y & _LOW_32
    across = x_high * y_low
    middle = ((x_low * y_low) >> 32) + (across & _LOW_32) + x_low * y_high
    return x_high * y_high + (across >> 32) + (middle >> 32)
