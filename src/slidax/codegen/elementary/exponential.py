"""`exp` and `expm1`."""

from __future__ import annotations

from .expression import Expression, fma, polynomial

INTEGER = 1.5 * 2.0**52 + 2046.0
"""A number plus this has the nearest integer in its lowest bits, plus 2046, which makes the integer positive."""

_LOG2_E = 1.4426950408889634
# ln 2 in two parts; the first has so few bits that its product with an exponent is exact.
_LN2_HIGH = float.fromhex("0x1.62e42fefa3800p-1")
_LN2_LOW = float.fromhex("0x1.ef35793c76730p-45")

# (e^r - 1 - r)/r² for |r| <= ln(2)/2, minimax; relative error of e^r 2^-57.
_TAIL = (
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
    """Two factors of `2^n` for n from -2044 to 2046, which one f64 cannot represent.

    - `shifted`: n + INTEGER.
    """
    bits = shifted.bits()
    half = bits >> 1
    return (half << 52).number(), ((bits - half) << 52).number()


def _parts(x: Expression) -> tuple[Expression, Expression, Expression]:
    """Numbers q, a and b with `e^x = (1 + q) a b`, q in (-.3, .42), a and b powers of two.

    Cody and Waite's reduction `x = n ln 2 + r`, |r| <= ln(2)/2, q = e^r - 1.
    """
    x = x.at_most(711.0).at_least(-746.0)
    shifted = fma(x, _LOG2_E, INTEGER)
    n = shifted - INTEGER
    r = fma(n, -_LN2_LOW, fma(n, -_LN2_HIGH, x))
    q = fma(r * r, polynomial(r, _TAIL), r)
    return q, *powers_of_two(shifted)


def exp(x: Expression) -> Expression:
    """`e^x`."""
    q, a, b = _parts(x)
    return fma(a, q, a) * b


def half_expm1(x: Expression) -> Expression:
    """`(e^x - 1)/2` as `(a q + (a - 1/b)) b/2`, which does not overflow before `sinh` does."""
    q, a, b = _parts(x)
    return _less_one(q, a, b) * (b * 0.5)


def expm1(x: Expression) -> Expression:
    """`e^x - 1` as `(a q + (a - 1/b)) b`."""
    q, a, b = _parts(x)
    # Only a zero has the wrong sign before.
    return (_less_one(q, a, b) * b).signed_as(x)


def _less_one(q: Expression, a: Expression, b: Expression) -> Expression:
    """`(1 + q) a - 1/b`."""
    # Twice the bits of 1, minus the bits of a power of two, are the bits of its inverse.
    return fma(a, q, a - (0x7FE0000000000000 - b.bits()).number())
