"""A function of arrays at many points, compiled once."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import Any

import equinox as eqx
import jax
import numpy as np
from numpy.typing import NDArray

from slidax.codegen import NoNativeCodeError, llvm, trace

Floats = NDArray[np.floating[Any]]


@dataclass(eq=False)
class Each:
    """Evaluates a function row by row; XLA takes ten times as long to compile what is asked for once.

    - `function`: from arrays to an array, or a tuple of them.
    """

    function: Callable[..., Any]
    _compiled: Callable[..., list[Any]] | None = field(default=None, init=False)

    def __call__(self, *rows: Any) -> list[Floats]:
        """What it gives, each with the row first.

        - `rows`: its arguments, each with the row first.
        """
        arrays = [np.ascontiguousarray(one, float) for one in rows]
        if self._compiled is None:
            self._compiled = _native(self.function, arrays) or _by_xla(self.function)
        return [np.asarray(one) for one in self._compiled(*arrays)]


def _native(function: Callable[..., Any], arrays: list[Floats]) -> Callable[..., list[Any]] | None:
    if not llvm.available():
        return None
    with suppress(NoNativeCodeError):
        program = trace(function, *(jax.ShapeDtypeStruct(one.shape[1:], float) for one in arrays), named=False)
        program.inputs[:] = [replace(one, varying=True) for one in program.inputs]
        kernel = llvm.compile(program)
        return lambda *given: list(kernel.batch(list(given), runs=len(given[0]), threads=1))
    return None


def _by_xla(function: Callable[..., Any]) -> Callable[..., list[Any]]:
    compiled = eqx.filter_jit(lambda *given: jax.vmap(function)(*given))
    return lambda *given: jax.tree.leaves(compiled(*given))
