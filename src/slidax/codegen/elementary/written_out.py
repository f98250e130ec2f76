"""From an elementary function to what it is written out as."""

from __future__ import annotations

from collections.abc import Callable

from slidax.codegen.builder import Builder
from slidax.codegen.form import Value

from .exponential import exp, expm1
from .expression import Expression
from .logarithm import log
from .power import power
from .trigonometric import cos, sin

_WRITTEN_OUT: dict[str, Callable[..., Expression]] = {
    "exp": exp,
    "expm1": expm1,
    "log": log,
    "sin": sin,
    "cos": cos,
    "pow": power,
}


def written_out(builder: Builder, op: str, args: tuple[Value, ...]) -> Value | None:
    """The value that replaces `builder.apply(op, *args)`; None for what is not an elementary function.

    - `builder`: makes it.
    - `op`: the function.
    - `args`: f64; or f32, which are computed as f64.
    """
    function = _WRITTEN_OUT.get(op)
    if function is None:
        return None
    arguments = [Expression(builder, arg).cast("convert", "f64") for arg in args]
    result = function(*arguments)
    return result.cast("convert", args[0].type).value
