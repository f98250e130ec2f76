"""A function of arrays as a program."""

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
    """`function(*args)` as a program, whose inputs are the arrays in `args` and whose outputs those in its result.

    An array is named after its argument and its place in it: `parameters.surface.k1`, `state.q`.

    - `function`: pure, of pytrees of arrays.
    - `args`: arrays, or shapes with dtypes; their numbers are not looked at.
    - `names`: of the arguments; None: `arg0`, `arg1`, ...
    - `named`: whether each value is told where in the source it came from; takes time.
    - `library`: has the functions that stay functions; None: all is written out.

    Raises NoNativeCodeError if it holds a primitive that has no rule, or one whose rule fails.
    """
    builder = Builder()
    shapes = jax.tree.map(lambda x: jax.ShapeDtypeStruct(np.shape(x), jax.dtypes.canonicalize_dtype(_dtype(x))), args)
    closed, result = jax.make_jaxpr(function, return_shape=True)(*shapes)
    with in_one_line(lambda: "the function"):
        inputs = [
            builder.input(name, ir_type(leaf.dtype, name), leaf.shape)
            for name, leaf in leaves(shapes, names or _numbered(args))
        ]
        results = inline(builder, closed, inputs, named=named, library=library)
        outputs = [name for name, _ in leaves((result,), ("",))]
        for name, values, aval in zip(outputs, results, closed.out_avals, strict=True):
            builder.output(name, ir_type(aval.dtype, name), values)
        return builder.finish()


def leaves(trees: Sequence[Any], names: Sequence[str]) -> list[tuple[str, Any]]:
    """The arrays in trees, each with its name.

    - `trees`: pytrees.
    - `names`: one for each tree.
    """
    found = []
    for tree, name in zip(trees, names, strict=True):
        for path, leaf in jax.tree_util.tree_leaves_with_path(tree):
            found.append(((name + _written(path)).lstrip("."), leaf))
    return found


def ir_type(dtype: Any, name: str) -> Any:
    """The IR's type of a dtype.

    - `dtype`: NumPy's.
    - `name`: of the array, for the error.

    Raises NoNativeCodeError if it has none.
    """
    try:
        return type_of(dtype)
    except NotImplementedError as error:
        raise NoNativeCodeError(f"`{name}`: no native code for {error}") from None


def _written(path: Sequence[Any]) -> str:
    parts = []
    for key in path:
        for field in ("name", "key", "idx"):
            if hasattr(key, field):
                parts.append(str(getattr(key, field)))
                break
    return "".join(f".{part}" for part in parts)


def _numbered(args: Sequence[Any]) -> list[str]:
    return [f"arg{k}" for k in range(len(args))]


def _dtype(x: Any) -> Any:
    return x.dtype if hasattr(x, "dtype") else np.asarray(x).dtype
