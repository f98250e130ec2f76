"""Trigonometric functions and their inverses in correctly rounded operations."""

from __future__ import annotations

from itertools import pairwise

from .expression import SIGN, Expression, branch_rarely, fma, polynomial, select

# pi/2 in two parts.
_HUGE_PI_2_HIGH = float.fromhex("0x1.921fb54442d18p+0")
_HUGE_PI_2_LOW = float.fromhex("0x1.1a62633145c07p-54")
_LOW_32 = 0xFFFFFFFF

# Binary digits of 2/pi, after 31 zeros.
_HUGE_TWO_OVER_PI = (
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


def reduce_huge_angle(x: Expression) -> tuple[Expression, Expression, Expression]:
    """Return r, r' and n with `x = n pi/2 + r - r'` and |r| <= pi/4.

    r' is the rounding error of r. n is a u64, correct modulo 4. Payne and Hanek's reduction: the mantissa is multiplied
    only by some digits of 2/pi, since earlier ones give full turns, and later ones fractions below 2^-117.

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
    r = fraction * _HUGE_PI_2_HIGH
    error = fma(fraction, -_HUGE_PI_2_LOW, fma(rest, -_HUGE_PI_2_HIGH, -fma(fraction, _HUGE_PI_2_HIGH, -r)))
    sign = (x.bits() ^ select(negative, n.constant(SIGN), 0)) & SIGN
    # x - x is NaN at infinity.
    return (
        r.flipped(sign) + (x - x),
        error.flipped(sign),
        select(x < 0.0, 0 - n, n),
    )


def _digits(first: Expression) -> tuple[Expression, Expression, Expression]:
    """Return 192 binary digits of 2/pi, without the first `first` digits, as three u64.

    - `first`: u64, less than 1024.
    """
    words = [first.constant(word) for word in _HUGE_TWO_OVER_PI]
    for bit in (8, 4, 2, 1):
        skip = (first & (64 * bit)).differs(0)
        words = [select(skip, words[k + bit], words[k]) for k in range(bit + 3)]
    by = first & 63
    a, b, c = [(word << by) | ((following >> 1) >> (63 - by)) for word, following in pairwise(words)]
    return a, b, c


def _product(mantissa: Expression, words: tuple[Expression, Expression, Expression]) -> tuple[Expression, Expression]:
    """Return the upper 128 of the lowest 192 bits of the mantissa times the 192-bit number in `words`, as two u64."""
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


_HUGE = 1e7
# A number plus this has the nearest integer in its lowest bits.
_INTEGER = 1.5 * 2.0**52
_TWO_OVER_PI = float.fromhex("0x1.45f306dc9c883p-1")
# pi/2 in three parts; the second has so few bits that its product with n < 2^23 is exact.
_PI_2_HIGH = float.fromhex("0x1.921fb54442d18p+0")
_PI_2_MIDDLE = float.fromhex("0x1.1a62633000000p-54")
_PI_2_LOW = float.fromhex("0x1.45c06e0e68948p-86")

# (1 - sin(r)/r)/z, z = r², for |r| <= pi/4, minimax; relative error of the sine 2^-58.
_SINE = (
    0.1666666666666663,
    -0.008333333333322097,
    0.0001984126982957284,
    -2.7557313615573764e-06,
    2.5050746850397758e-08,
    -1.5896177118413884e-10,
)
# (cos(r) - 1 + z/2)/z².
_COSINE = (
    0.041666666666666595,
    -0.001388888888887304,
    2.4801587288841407e-05,
    -2.755731417624181e-07,
    2.0875700416232235e-09,
    -1.1358513955463273e-11,
)


def _reduce(x: Expression) -> tuple[Expression, ...]:
    """Return r, r' and n with `x = n pi/2 + r - r'`, |r| <= pi/4, r' a rounding error, n an u64 mod 4.

    Cody and Waite's reduction up to |x| = 1e7, exact except for the last sum; beyond that `reduce_huge_angle`.
    """
    shifted = fma(x, _TWO_OVER_PI, _INTEGER)
    n = shifted - _INTEGER
    first = fma(n, -_PI_2_HIGH, x)
    r = fma(n, -_PI_2_MIDDLE, first)
    rest = fma(n, _PI_2_LOW, fma(n, _PI_2_MIDDLE, r - first))
    return branch_rarely(abs(x) >= _HUGE, lambda: reduce_huge_angle(x), (r, rest, shifted.bits()))


def _sine_and_cosine(x: Expression) -> tuple[Expression, Expression, Expression]:
    """Return sine and cosine of the reduced angle r - r', and n; r, r' and n are as in `_reduce`."""
    r, rest, n = _reduce(x)
    z = r * r
    # Written as a difference, so that the sine of -0 is -0.
    sine = r - fma(r * z, polynomial(z, _SINE), rest)
    square = fma(r, r, r * (rest * -2.0))
    cosine = fma(square, fma(z, polynomial(z, _COSINE), -0.5), 1.0)
    return sine, cosine, n


def sin(x: Expression) -> Expression:
    """`sin x`."""
    sine, cosine, n = _sine_and_cosine(x)
    return select((n & 1).equals(0), sine, cosine).flipped((n & 2) << 62)


def cos(x: Expression) -> Expression:
    """`cos x`."""
    sine, cosine, n = _sine_and_cosine(x)
    return select((n & 1).equals(0), cosine, sine).flipped(((n + 1) & 2) << 62)


def tan(x: Expression) -> Expression:
    """`tan x`."""
    sine, cosine, n = _sine_and_cosine(x)
    even = (n & 1).equals(0)
    return (select(even, sine, cosine) / select(even, cosine, sine)).flipped((n & 1) << 63)


_ARC_PI_2_HIGH = float.fromhex("0x1.921fb54442d18p+0")
_ARC_PI_2_LOW = float.fromhex("0x1.1a62633145c07p-54")

# (asin(s)/s - 1)/z, z = s² <= 1/4, minimax; relative error of the arc 2^-55.
_ARCSINE = (
    0.16666666666665383,
    0.07500000000342934,
    0.044642856823565814,
    0.03038195932795766,
    0.022371753600508814,
    0.017359769959820196,
    0.013884609684239445,
    0.012173206211403555,
    0.006511168240307607,
    0.01957304504302712,
    -0.01629271979061249,
    0.031958034121951896,
)
# (atan(t)/t - 1)/z, z = t² <= 1, minimax; relative error of the arc 2^-55.
_ARCTANGENT = (
    -0.3333333333333307,
    0.19999999999951754,
    -0.14285714282588252,
    0.11111111007345238,
    -0.09090907007837751,
    0.07692279889216634,
    -0.06666404424849409,
    0.058805298128690286,
    -0.052535267904048166,
    0.04722348372843085,
    -0.04219243595889901,
    0.03664316079718442,
    -0.029905749989981478,
    0.021987082532408497,
    -0.013902582772300554,
    0.0071978879119649645,
    -0.002885609851129574,
    0.0008315593265087142,
    -0.00015221101183611485,
    1.3229981404036539e-05,
)


def _arc(x: Expression) -> tuple[Expression, Expression]:
    """Return `|x| > 1/2`, and an angle: `asin sqrt((1 - |x|)/2)`, half of `acos |x|`, if true; `asin |x|` if false."""
    magnitude = abs(x)
    large = magnitude > 0.5
    z = select(large, 0.5 - 0.5 * magnitude, x * x)
    s = select(large, z.root(), magnitude)
    return large, fma(s * z, polynomial(z, _ARCSINE), s)


def asin(x: Expression) -> Expression:
    """`asin x`; for |x| > 1/2 as `pi/2 - 2 asin sqrt((1 - |x|)/2)`."""
    large, arc = _arc(x)
    return select(large, _ARC_PI_2_HIGH - fma(arc, 2.0, -_ARC_PI_2_LOW), arc).signed_as(x)


def acos(x: Expression) -> Expression:
    """`acos x = k pi/2 ± arc`, k = 0, 1, 2; arc is `2 asin sqrt((1 - |x|)/2)` for |x| > 1/2, else `asin |x|`."""
    large, arc = _arc(x)
    arc = select(large, arc + arc, -arc).flipped(x.bits() & SIGN)
    quarters = select(large, select(x < 0.0, x.constant(2.0), 0.0), 1.0)
    return fma(quarters, _ARC_PI_2_HIGH, fma(quarters, _ARC_PI_2_LOW, arc))


def _arctangent(t: Expression) -> Expression:
    """`atan t` for 0 <= t <= 1."""
    z = t * t
    return fma(t * z, polynomial(z, _ARCTANGENT), t)


def atan(x: Expression) -> Expression:
    """Arc tangent; for |x| > 1 it is `pi/2` minus the arc tangent of `1/|x|`."""
    magnitude = abs(x)
    steep = magnitude > 1.0
    arc = _arctangent(select(steep, 1.0 / magnitude, magnitude))
    return select(steep, _ARC_PI_2_HIGH - (arc - _ARC_PI_2_LOW), arc).signed_as(x)


def atan2(y: Expression, x: Expression) -> Expression:
    """The angle of (x, y), `k pi/2 ± atan(min/max)` of |x| and |y|, with the sign of y."""
    rise, run = abs(y), abs(x)
    steep = rise > run
    less, more = select(steep, run, rise), select(steep, rise, run)
    # The quotient of two zeros is 0, of two infinities 1.
    both_infinite = less.equals(float("inf")) & more.equals(float("inf"))
    quotient = select(both_infinite, 1.0, less / more.at_least(5e-324))
    backwards = (x.bits() >> 63).differs(0)
    arc = _arctangent(quotient)
    arc = select(steep ^ backwards, -arc, arc)
    quarters = select(steep, x.constant(1.0), select(backwards, x.constant(2.0), 0.0))
    return fma(quarters, _ARC_PI_2_HIGH, fma(quarters, _ARC_PI_2_LOW, arc)).signed_as(y)
