"""`cbrt`."""

from __future__ import annotations

from .expression import Expression, fma, polynomial, select
from .logarithm import SMALLEST_NORMAL

# A third of a number's upper bits approximates its cube root's; 2^52 + b has the integer b in its lowest bits.
_INTEGER = 0x4330000000000000
_THIRD_OF_BITS = 6004800933347025.0

# ((1 - h)^(-1/3) - 1)/h for |h| < .103, relative error 2^-32.
_INVERSE = (
    0.3333333456155788,
    0.2222222550943691,
    0.1728299108205333,
    0.14401765283592136,
    0.12667543966570663,
    0.11308894513399043,
)


def cbrt(x: Expression) -> Expression:
    """The cube root of x, from `|x|^(-1/3)`, which needs no division, and one Newton step."""
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
