"""Fuse multiply-adds: `a b + c` is rounded once, and costs no more than the sum."""

from __future__ import annotations

from .builder import Builder
from .ir import FLOATS, Program, Value
from .rebuild import Replace, rebuild


def fuse(program: Program) -> Program:
    """Return the program with products fused into the sums that use them."""
    return rebuild(program, fused())


def fused() -> Replace:
    """Return the replacement for `rebuild` that fuses products into sums and differences.

    A product is fused if it stands in the region of the sum; one outside the loop is computed already. Other users of
    the product do not matter, so that a run rounds alike whatever it logs. With two products, their order alone decides
    which is fused, so that every target rounds alike.
    """

    def replace(builder: Builder, value: Value, args: tuple[Value, ...]) -> Value | None:
        if value.op not in ("add", "sub") or value.type not in FLOATS:
            return None
        # The sum usually waits for the later product.
        for k in sorted((0, 1), key=lambda k: -value.args[k].number):
            product = args[k]
            if product.op == "mul" and value.args[k].region is value.region:
                a, b = product.args
                c = args[1 - k]
                if value.op == "sub":
                    if k == 0:
                        c = builder.apply("neg", c, type=value.type)
                    else:
                        a = builder.apply("neg", a, type=value.type)
                return builder.apply("fma", a, b, c, type=value.type)
        return None

    return replace
