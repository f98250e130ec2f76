"""`sin`, `cos` and `tan`."""

from __future__ import annotations

from . import huge_angle
from .expression import Expression, fma, polynomial, rarely, select

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


def _reduced(x: Expression) -> tuple[Expression, ...]:
    """Three numbers: r, r' and n with `x = n pi/2 + r - r'`, |r| <= pi/4, r' a rounding error, n an u64 mod 4.

    Cody and Waite's reduction up to |x| = 1e7, exact except for the last sum; beyond it a branch.
    """
    shifted = fma(x, _TWO_OVER_PI, _INTEGER)
    n = shifted - _INTEGER
    first = fma(n, -_PI_2_HIGH, x)
    r = fma(n, -_PI_2_MIDDLE, first)
    rest = fma(n, _PI_2_LOW, fma(n, _PI_2_MIDDLE, r - first))
    return rarely(abs(x) >= _HUGE, lambda: huge_angle.reduced(x), (r, rest, shifted.bits()))


def _sine_and_cosine(x: Expression) -> tuple[Expression, Expression, Expression]:
    """`sin r`, `cos r` and n."""
    r, rest, n = _reduced(x)
    z = r * r
    # A difference, so that the sine of -0 is -0.
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
