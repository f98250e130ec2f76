"""`asin`, `acos`, `atan` and `atan2`."""

from __future__ import annotations

from .expression import SIGN, Expression, fma, polynomial, select

_PI_2_HIGH = float.fromhex("0x1.921fb54442d18p+0")
_PI_2_LOW = float.fromhex("0x1.1a62633145c07p-54")

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
    """True if |x| > 1/2, and then `asin sqrt((1 - |x|)/2)`, which is half of `acos |x|`; else `asin |x|`."""
    magnitude = abs(x)
    large = magnitude > 0.5
    z = select(large, 0.5 - 0.5 * magnitude, x * x)
    s = select(large, z.root(), magnitude)
    return large, fma(s * z, polynomial(z, _ARCSINE), s)


def asin(x: Expression) -> Expression:
    """`asin x`; for |x| > 1/2 as `pi/2 - 2 asin sqrt((1 - |x|)/2)`."""
    large, arc = _arc(x)
    return select(large, _PI_2_HIGH - fma(arc, 2.0, -_PI_2_LOW), arc).signed_as(x)


def acos(x: Expression) -> Expression:
    """`acos x = k pi/2 ± arc`, with the arc of `asin`; k = 0, 1, 2."""
    large, arc = _arc(x)
    arc = select(large, arc + arc, -arc).flipped(x.bits() & SIGN)
    quarters = select(large, select(x < 0.0, x.constant(2.0), 0.0), 1.0)
    return fma(quarters, _PI_2_HIGH, fma(quarters, _PI_2_LOW, arc))


def _arctangent(t: Expression) -> Expression:
    """`atan t` for 0 <= t <= 1."""
    z = t * t
    return fma(t * z, polynomial(z, _ARCTANGENT), t)


def atan(x: Expression) -> Expression:
    """Arc tangent; for |x| > 1 it is `pi/2` minus the arc tangent of `1/|x|`."""
    magnitude = abs(x)
    steep = magnitude > 1.0
    arc = _arctangent(select(steep, 1.0 / magnitude, magnitude))
    return select(steep, _PI_2_HIGH - (arc - _PI_2_LOW), arc).signed_as(x)


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
    return fma(quarters, _PI_2_HIGH, fma(quarters, _PI_2_LOW, arc)).signed_as(y)
