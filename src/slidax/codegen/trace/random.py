"""Random numbers: JAX's own generator, threefry with 2 x 32 bits and 20 rounds (Salmon et al., 2011)."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import jax
import numpy as np

from slidax.codegen.builder import Builder, Values
from slidax.codegen.fold import DTYPES
from slidax.codegen.ir import Value

from .arrays import Inline, each, of_numbers, value_array

PARITY = 0x1BD11BDA
ROTATIONS = ((13, 15, 26, 6), (17, 29, 16, 24))


def threefry(b: Builder, equation: Any, arrays: list[Values]) -> list[Values]:
    """Rule of threefry: two words from a key of two words and a counter of two words, for each element."""
    arrays = list(np.broadcast_arrays(*arrays))
    pairs = [_threefry(b, *row) for row in zip(*(array.ravel() for array in arrays), strict=True)]
    shape = arrays[0].shape
    return [value_array([pair[k] for pair in pairs], shape) for k in (0, 1)]


def _threefry(b: Builder, key0: Value, key1: Value, x0: Value, x1: Value) -> tuple[Value, Value]:
    apply = b.apply
    parity = b.constant(PARITY, "u32")
    keys = (key0, key1, apply("xor", apply("xor", key0, key1), parity))
    x0, x1 = apply("add", x0, keys[0]), apply("add", x1, keys[1])
    for block in range(5):
        for distance in ROTATIONS[block % 2]:
            x0 = apply("add", x0, x1)
            left = apply("shl", x1, b.constant(distance, "u32"))
            right = apply("shr", x1, b.constant(32 - distance, "u32"))
            x1 = apply("xor", apply("or", left, right), x0)
        x0 = apply("add", x0, keys[(block + 1) % 3])
        x1 = apply("add", apply("add", x1, keys[(block + 2) % 3]), b.constant(block + 1, "u32"))
    return x0, x1


def counters(b: Builder, equation: Any, arrays: list[Values]) -> list[Values]:
    """High and low words of 0, 1, 2, ..., in the requested shape."""
    shape = equation.params["shape"]
    low = np.arange(int(np.prod(shape, dtype=int)), dtype=np.uint32).reshape(shape)
    return [of_numbers(b, np.zeros_like(low)), of_numbers(b, low)]


def _implementation(equation: Any) -> Any:
    impl = equation.params.get("impl")
    return impl if impl is not None else equation.invars[0].aval.dtype._impl


def by_implementation(name: str) -> Callable[[Builder, Any, list[Values], Inline], list[Values]]:
    """Rule of a primitive on keys: the function `name` of JAX's generator, inlined."""

    def rule(b: Builder, equation: Any, arrays: list[Values], inline: Inline) -> list[Values]:
        impl = _implementation(equation)
        if impl.name != "threefry2x32":
            raise NotImplementedError(f"the generator `{impl.name}`; use JAX's default, threefry2x32")
        if equation.invars[0].aval.ndim:
            raise NotImplementedError("an array of keys")
        function = getattr(impl, name)
        more: tuple[Any, ...] = ()
        if name == "random_bits":
            more = (equation.params["bit_width"], equation.params["shape"])
        elif name == "split":
            more = (equation.params["shape"],)
        shapes = [jax.ShapeDtypeStruct(array.shape, _dtype(array)) for array in arrays]
        jaxpr = jax.make_jaxpr(lambda *args: function(*args, *more))(*shapes)
        return inline(jaxpr, arrays)

    return rule


def _dtype(array: Values) -> Any:
    return DTYPES[array.flat[0].type]


def key_words(b: Builder, equation: Any, arrays: list[Values]) -> Values:
    """Return a key's words: the key itself."""
    return each(lambda x: x, arrays[0])
