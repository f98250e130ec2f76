"""Primitives that only move elements; no operation remains of them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from slidax.codegen.builder import Builder, Values

from .arrays import filled, of_numbers, type_of


def _broadcast(b: Builder, equation: Any, arrays: list[Values]) -> Values:
    shape, places = equation.params["shape"], equation.params["broadcast_dimensions"]
    full = [1] * len(shape)
    for place, length in zip(places, arrays[0].shape, strict=True):
        full[place] = length
    return np.broadcast_to(arrays[0].reshape(full), shape)


def _slice(b: Builder, equation: Any, arrays: list[Values]) -> Values:
    starts, limits = equation.params["start_indices"], equation.params["limit_indices"]
    strides = equation.params["strides"] or [1] * len(starts)
    return arrays[0][tuple(slice(*ends) for ends in zip(starts, limits, strides, strict=True))]


def _pad(b: Builder, equation: Any, arrays: list[Values]) -> Values:
    array, padding = arrays
    low, high, between = ([int(k) for k in part] for part in zip(*equation.params["padding_config"], strict=True))
    spread = [length + max(length - 1, 0) * gap for length, gap in zip(array.shape, between, strict=True)]
    full = [max(lo, 0) + length + max(hi, 0) for lo, length, hi in zip(low, spread, high, strict=True)]
    result = filled(padding.item(), tuple(full))
    result[
        tuple(
            slice(max(lo, 0), max(lo, 0) + length, gap + 1)
            for lo, length, gap in zip(low, spread, between, strict=True)
        )
    ] = array
    # A negative padding removes elements.
    return result[tuple(slice(max(-lo, 0), n - max(-hi, 0)) for lo, hi, n in zip(low, high, full, strict=True))]


def _iota(b: Builder, equation: Any, arrays: list[Values]) -> Values:
    shape, along = equation.params["shape"], equation.params["dimension"]
    counted = of_numbers(b, np.arange(shape[along], dtype=np.dtype(equation.params["dtype"])))
    return np.broadcast_to(counted.reshape([-1 if k == along else 1 for k in range(len(shape))]), shape)


def _unstack(b: Builder, equation: Any, arrays: list[Values]) -> list[Values]:
    return (
        [part.reshape(part.shape) for part in np.moveaxis(arrays[0], equation.params["axis"], 0)]
        if (arrays[0].ndim > 1)
        else [arrays[0][k : k + 1].reshape(()) for k in range(arrays[0].shape[0])]
    )


def _split(b: Builder, equation: Any, arrays: list[Values]) -> list[Values]:
    ends = np.cumsum(equation.params["sizes"])[:-1]
    return list(np.split(arrays[0], ends, axis=equation.params["axis"]))


def _expand(b: Builder, equation: Any, arrays: list[Values]) -> Values:
    return arrays[0].reshape(equation.outvars[0].aval.shape)


def _platform(b: Builder, equation: Any, arrays: list[Values]) -> Values:
    """Index of the branch that JAX itself takes on the CPU."""
    platforms = equation.params["platforms"]
    return of_numbers(b, np.int32(next(k for k, names in enumerate(platforms) if names is None or "cpu" in names)))


def _empty(b: Builder, equation: Any, arrays: list[Values]) -> Values:
    return filled(b.constant(0, type_of(equation.outvars[0].aval.dtype)), equation.outvars[0].aval.shape)


SHAPE_RULES: dict[str, Callable[[Builder, Any, list[Values]], Values | list[Values]]] = {
    "broadcast_in_dim": _broadcast,
    "reshape": _expand,
    "squeeze": _expand,
    "expand_dims": _expand,
    "slice": _slice,
    "pad": _pad,
    "iota": _iota,
    "transpose": lambda b, eqn, arrays: arrays[0].transpose(eqn.params["permutation"]),
    "rev": lambda b, eqn, arrays: np.flip(arrays[0], eqn.params["dimensions"]),
    "concatenate": lambda b, eqn, arrays: np.concatenate(arrays, axis=eqn.params["dimension"]),
    "stack": lambda b, eqn, arrays: np.stack(arrays, axis=eqn.params["axis"]),
    "unstack": _unstack,
    "split": _split,
    "empty": _empty,
    "platform_index": _platform,
    "optimization_barrier": lambda b, eqn, arrays: arrays,
    "device_put": lambda b, eqn, arrays: arrays,
}
"""Rule of each primitive, by its name."""
