"""Elementary functions that are written out once, and called."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from slidax.codegen.builder import Builder
from slidax.codegen.ir import Program, Type, Value

from .prepare import lowered_and_fused
from .words import typed


@dataclass(frozen=True)
class Called:
    """One of them.

    - `op`: the function.
    - `type`: of its arguments and of its result.
    - `arguments`: how many.
    - `width`: as many numbers are computed side by side.
    """

    op: str
    type: Type
    arguments: int
    width: int

    @classmethod
    def by(cls, value: Value, width: int) -> Called:
        """What computes a value.

        - `value`: an elementary function of something.
        - `width`: as in the class.
        """
        return cls(value.op, value.type, len(value.args), width)

    @property
    def head(self) -> str:
        """Type and name, as LLVM writes them before the arguments."""
        return f"{typed(self.type, self.width)} @own_{self.op}_{self.type}_{self.width}"

    @property
    def program(self) -> Program:
        """It in operations that are all exactly rounded."""
        builder = Builder()
        given = [builder.input(f"x{k}", self.type, (), varying=True).item() for k in range(self.arguments)]
        builder.output("y", self.type, np.array(builder.apply(self.op, *given, type=self.type), object))
        return lowered_and_fused(builder.finish())

    def called(self, words: list[str]) -> str:
        """The call, as LLVM writes it.

        - `words`: its arguments.
        """
        whole = typed(self.type, self.width)
        return f"call {self.head}({', '.join(f'{whole} {word}' for word in words)})"
