"""Trace a function of arrays to a program."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import jax
import numpy as np

from slidax.codegen.builder import Builder
from slidax.codegen.ir import Program
from slidax.codegen.no_native_code import NoNativeCodeError, in_one_line

from .arrays import type_of
from .inline import inline
from .library import Library


def trace(
    function: Callable[..., Any],
    *args: Any,
    names: Sequence[str] | None = None,
    named: bool = True,
    library: Library | None = None,
) -> Program:
    """Return `function(*args)` as a program; its inputs are the arrays in `args`, its outputs those in the result.

    An array is named after its argument and its path in it: `parameters.surface.k1`, `state.q`.

    - `function`: pure, of pytrees of arrays.
    - `args`: arrays, or shapes with dtypes; their numbers are not used.
    - `names`: names of the arguments; None: `arg0`, `arg1`, ...
    - `named`: true if each value gets its origin in the source; takes time.
    - `library`: functions that stay functions; None inlines all of them.

    Raises NoNativeCodeError if a primitive has no rule or its rule fails.
    """
    builder = Builder()
    shapes = jax.tree.map(lambda x: jax.ShapeDtypeStruct(np.shape(x), jax.dtypes.canonicalize_dtype(_dtype(x))), args)
    closed, result = jax.make_jaxpr(function, return_shape=True)(*shapes)
    with in_one_line(lambda: "the function"):
        inputs = [
            builder.input(name, ir_type(leaf.dtype, name), leaf.shape)
            for name, leaf in leaves(shapes, names or [f"arg{k}" for k in range(len(args))])
        ]
        results = inline(builder, closed, inputs, named=named, library=library)
        outputs = [name for name, _ in leaves((result,), ("",))]
        for name, values, aval in zip(outputs, results, closed.out_avals, strict=True):
            builder.output(name, ir_type(aval.dtype, name), values)
        return builder.finish()


def leaves(trees: Sequence[Any], names: Sequence[str]) -> list[tuple[str, Any]]:
    """Return the arrays in pytrees, each with its name.

    - `names`: a name for each tree.
    """
    arrays = []
    for tree, name in zip(trees, names, strict=True):
        for path, leaf in jax.tree_util.tree_leaves_with_path(tree):
            arrays.append(((name + _path_text(path)).lstrip("."), leaf))
    return arrays


def ir_type(dtype: Any, name: str) -> Any:
    """Return the IR type of a dtype.

    - `name`: name of the array, for the error.

    Raises NoNativeCodeError if it has none.
    """
    try:
        return type_of(dtype)
    except NotImplementedError as error:
        raise NoNativeCodeError(f"`{name}`: no native code for {error}") from None


def _path_text(path: Sequence[Any]) -> str:
    parts = []
    for key in path:
        for field in ("name", "key", "idx"):
            if hasattr(key, field):
                parts.append(str(getattr(key, field)))
                break
    return "".join(f".{part}" for part in parts)


def _dtype(x: Any) -> Any:
    return x.dtype if hasattr(x, "dtype") else np.asarray(x).dtype
