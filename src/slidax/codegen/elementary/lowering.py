"""Expand elementary functions into correctly rounded operations; the error function and its inverse."""

from __future__ import annotations

from collections.abc import Callable

from ..builder import Builder
from ..ir import Value
from .exponentials import cbrt, cosh, exp, expm1, log, log1p, power, sinh, tanh
from .expression import Expression, branch_rarely, fma, polynomial, select
from .trigonometry import acos, asin, atan, atan2, cos, sin, tan

# erf(x)/x - 1 as a polynomial in z = x² <= 1, minimax; relative error 2^-56.
_NEAR = (
    0.12837916709551256,
    -0.37612638903183376,
    0.11283791670939436,
    -0.026866170642465787,
    0.005223977601465207,
    -0.0008548325729327705,
    0.00012055288135398485,
    -1.4924616140075908e-05,
    1.6446030590129855e-06,
    -1.6198434618901846e-07,
    1.3678947418761685e-08,
    -7.72299092113954e-10,
)
# ln(1 - erf(x)) as a polynomial in x for 1 <= x <= 6, minimax; error of erf 2^-54.
_FAR = (
    -1.063612703715242e-06,
    -1.1283687119628316,
    -0.6366675800244586,
    -0.10263764576025404,
    0.018865375166701417,
    0.0005840798766249186,
    -0.0020987966562092193,
    0.0009199660413617304,
    -0.00023066607895222882,
    2.800867463987245e-05,
    3.6065045288866678e-06,
    -2.6716529025575317e-06,
    6.874622435108346e-07,
    -1.081757760494399e-07,
    1.0898547830303082e-08,
    -6.515034734487442e-10,
    1.7694925332636164e-11,
)
# erf_inv(x)/x as a polynomial in w = -ln(1 - x²) <= 5, minimax; relative error 2^-54.
_INVERSE_NEAR = (
    0.886226925452758,
    0.23201366653464803,
    0.011549342038456393,
    -0.002335101643793338,
    -0.0001280432803819059,
    4.661138564118207e-05,
    2.020134490295666e-06,
    -1.0128299193616296e-06,
    -3.6910561150796476e-08,
    2.2387057099478328e-08,
    1.0851212663596368e-09,
    -7.335938605465739e-10,
    8.72593630335247e-11,
    -2.7591759486152334e-11,
    1.2184694534844278e-11,
    -2.922010685174969e-12,
    4.0617535790173477e-13,
    -3.259407503845148e-14,
    1.1178964705788548e-15,
    3.9147700306062796e-17,
    -5.1693268548990535e-18,
    1.4720683294164654e-19,
)
# erf_inv(x)/(x sqrt(w)) as a polynomial in 36/(w + 8) - 1.8, 5 <= w < 37.
_INVERSE_FAR = (
    0.952433701572083,
    -0.025320212135861296,
    -0.000912204547324888,
    0.00032711527102298644,
    0.0011524738112677312,
    0.0011393888778253754,
    0.0008336313429696269,
    0.000254077652742233,
    -8.352116161374394e-05,
    -8.179511947440605e-05,
    1.768789808533691e-05,
    2.563896458048445e-05,
    -3.344733440574085e-06,
    -4.786078823280943e-06,
    2.2374945812379704e-06,
    3.9870441567154976e-07,
    -8.645817489010833e-07,
    2.6306407659191053e-07,
    2.0143655459205787e-07,
    -1.564422462860039e-07,
    -8.112137798551697e-09,
    4.184649897309423e-08,
    -8.023185035369917e-09,
    -4.99559312620595e-09,
    1.6760959950467623e-09,
)


def erf(x: Expression) -> Expression:
    """`erf x`; for |x| > 1 as `1 - e^P(|x|)` with a polynomial P."""
    magnitude = abs(x)
    near = fma(magnitude, polynomial(x * x, _NEAR), magnitude)
    far = 1.0 - exp(polynomial(magnitude.at_most(6.0), _FAR))
    return select(magnitude > 1.0, far, near).signed_as(x)


def erf_inv(x: Expression) -> Expression:
    """The y with `erf y = x`: x times a polynomial in `w = -ln(1 - x²)` (M. Giles, 2010).

    For w > 5, it is `x sqrt(w)` times a polynomial in `36/(w + 8)`.
    """
    w = -log((1.0 - x) * (x + 1.0))
    near = polynomial(w, _INVERSE_NEAR)

    def far() -> tuple[Expression, ...]:
        return (w.root() * polynomial(36.0 / (w + 8.0) - 1.8, _INVERSE_FAR),)

    (ratio,) = branch_rarely(w > 5.0, far, (near,))
    return x * ratio


_LOWERED: dict[str, Callable[..., Expression]] = {
    function.__name__: function
    for function in (
        *(exp, expm1, log, log1p, cbrt, sinh, cosh, tanh, erf, erf_inv),
        *(sin, cos, tan, asin, acos, atan, atan2),
    )
} | {"pow": power}


def lower(builder: Builder, op: str, args: tuple[Value, ...]) -> Value | None:
    """Add an elementary function to a program, expanded into basic operations; return its result as an IR value.

    Returns None if `op` is not an elementary function. Computes in f64, also for arguments of type f32.

    - `op`, `args`: name of the function, and its arguments.
    """
    function = _LOWERED.get(op)
    if function is None:
        return None
    arguments = [Expression(builder, arg).cast("convert", "f64") for arg in args]
    result = function(*arguments)
    return result.cast("convert", args[0].type).value
