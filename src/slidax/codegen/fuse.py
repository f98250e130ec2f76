"""Multiply-adds: `a b + c` rounded once, which costs what the sum alone would."""

from __future__ import annotations

from .builder import Builder
from .ir import FLOATS, Program, Value
from .rebuild import Replace, rebuild


def fuse(program: Program) -> Program:
    """The same program with its products fused into the sums that they are for.

    - `program`: stays as it is.
    """
    return rebuild(program, fused())


def fused() -> Replace:
    """What `rebuild` replaces to fuse: sums and differences with a product in them.

    A product is fused if it stands in the sum's own region: one from outside of a loop is there already. What else
    needs it does not matter, so that a run rounds alike whatever of it is logged. Which of two products is fused
    depends on their order alone, so that whatever is printed from the program rounds alike.
    """

    def replace(builder: Builder, value: Value, args: tuple[Value, ...]) -> Value | None:
        if value.op not in ("add", "sub") or value.type not in FLOATS:
            return None
        # The later product is as a rule the one that the sum waits for.
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
