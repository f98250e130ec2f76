"""Functions of arrays evaluated at many points, compiled once."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import Any, TypeAlias

import equinox as eqx
import jax
import numpy as np
from numpy.typing import NDArray

from slidax.codegen import NoNativeCodeError, llvm, trace

Floats: TypeAlias = NDArray[np.floating[Any]]
Flags: TypeAlias = NDArray[np.bool_]


@dataclass(eq=False)
class Each:
    """A function evaluated row by row, by native code if possible: XLA takes ten times as long to compile for one use.

    - `function`: from arrays to an array, or a tuple of them.
    """

    function: Callable[..., Any]
    _compiled: Callable[..., list[Any]] | None = field(default=None, init=False)

    def __call__(self, *rows: Any) -> list[Floats]:
        """Return the outputs; arguments and outputs have the row as first axis."""
        arrays = [np.ascontiguousarray(row, float) for row in rows]
        if self._compiled is None:
            self._compiled = _native(self.function, arrays) or _by_xla(self.function)
        return [np.asarray(output) for output in self._compiled(*arrays)]


def _native(function: Callable[..., Any], arrays: list[Floats]) -> Callable[..., list[Any]] | None:
    if not llvm.available():
        return None
    with suppress(NoNativeCodeError):
        program = trace(function, *(jax.ShapeDtypeStruct(array.shape[1:], float) for array in arrays), named=False)
        program.inputs[:] = [replace(source, varying=True) for source in program.inputs]
        kernel = llvm.compile(program)
        return lambda *rows: list(kernel.batch(list(rows), runs=len(rows[0]), threads=1))
    return None


def _by_xla(function: Callable[..., Any]) -> Callable[..., list[Any]]:
    compiled = eqx.filter_jit(lambda *rows: jax.vmap(function)(*rows))
    return lambda *rows: jax.tree.leaves(compiled(*rows))
