"""Expand elementary functions."""

from __future__ import annotations

from collections.abc import Callable

from slidax.codegen.builder import Builder
from slidax.codegen.ir import Value

from .cube_root import cbrt
from .error_function import erf, erf_inv
from .exponential import exp, expm1
from .expression import Expression
from .hyperbolic import cosh, sinh, tanh
from .inverse_trigonometric import acos, asin, atan, atan2
from .logarithm import log, log1p
from .power import power
from .trigonometric import cos, sin, tan

_LOWERED: dict[str, Callable[..., Expression]] = {
    "exp": exp,
    "expm1": expm1,
    "log": log,
    "log1p": log1p,
    "pow": power,
    "cbrt": cbrt,
    "sin": sin,
    "cos": cos,
    "tan": tan,
    "asin": asin,
    "acos": acos,
    "atan": atan,
    "atan2": atan2,
    "sinh": sinh,
    "cosh": cosh,
    "tanh": tanh,
    "erf": erf,
    "erf_inv": erf_inv,
}


def lower(builder: Builder, op: str, args: tuple[Value, ...]) -> Value | None:
    """Build the expansion of `builder.apply(op, *args)`; None if `op` is not an elementary function.

    Computes in f64, also for arguments of type f32.
    """
    function = _LOWERED.get(op)
    if function is None:
        return None
    arguments = [Expression(builder, arg).cast("convert", "f64") for arg in args]
    result = function(*arguments)
    return result.cast("convert", args[0].type).value
