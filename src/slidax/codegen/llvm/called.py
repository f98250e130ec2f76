"""Elementary functions that a module defines once and calls."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from slidax.codegen.builder import Builder
from slidax.codegen.ir import Program, Type, Value

from .prepare import lowered_and_fused
from .words import typed


@dataclass(frozen=True)
class ElementaryFunction:
    """An elementary function of scalars or vectors.

    - `op`: its operation.
    - `type`: of the arguments and the result.
    - `arguments`: number of arguments.
    - `width`: number of lanes.
    """

    op: str
    type: Type
    arguments: int
    width: int

    @classmethod
    def of(cls, value: Value, width: int) -> ElementaryFunction:
        """Return the function that computes a value."""
        return cls(value.op, value.type, len(value.args), width)

    @property
    def head(self) -> str:
        """Result type and name in LLVM IR."""
        return f"{typed(self.type, self.width)} @own_{self.op}_{self.type}_{self.width}"

    @property
    def program(self) -> Program:
        """The function in correctly rounded operations."""
        builder = Builder()
        arguments = [builder.input(f"x{k}", self.type, (), varying=True).item() for k in range(self.arguments)]
        builder.output("y", self.type, np.array(builder.apply(self.op, *arguments, type=self.type), object))
        return lowered_and_fused(builder.finish())

    def call(self, words: list[str]) -> str:
        """Return a call with these arguments in LLVM IR."""
        whole = typed(self.type, self.width)
        return f"call {self.head}({', '.join(f'{whole} {word}' for word in words)})"
