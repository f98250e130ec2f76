"""Recursion of the decoupled bound: coupling enters as a disturbance of bounded magnitude."""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from .padded import padded
from .propagation import Answers, Bounds, Course, First, Passing, carried_at_first, sampled

BLOCK = 32
"""Samples whose earlier inputs are summed at once: a trade-off between sequential and parallel work."""


@dataclass(frozen=True)
class Apart:
    """The loops of the joints, each for some κ; units of periods.

    - `kernels`: sizes of responses to disturbances, targets and changes of target, the newest last [9 n j L] each.
    - `tails`: bounds of the effect of older inputs, of each, times their largest, faded.
    - `fading`: a period's share of that [n j].
    - `spread`: bound of `|κ(t)/κ - 1|` for each κ [n j]; `kappa`: these κ [n j].
    - `coupling`: of the joints' accelerations [n n].
    """

    kernels: tuple[Any, Any, Any]
    tails: tuple[Any, Any, Any]
    fading: Any
    spread: Any
    kappa: Any
    coupling: Any


jax.tree_util.register_dataclass(Apart, data_fields=list(Apart.__dataclass_fields__), meta_fields=[])


def propagated(course: Course, apart: Apart, passing: Passing, first: First, most: int = 0) -> Bounds:
    """Return the bounds of all samples, over all κ.

    - `most`: largest number of samples of all calls that share the compiled program.
    """
    count = passing.now.shape[0]
    blocks = -(-max(count, most) // BLOCK)

    # Padding after the last sample does not affect earlier samples, and is cut off.
    def in_blocks(values: Any) -> Any:
        whole = padded(values, blocks * BLOCK)
        return jnp.asarray(whole.reshape(blocks, BLOCK, *whole.shape[1:]))

    bounds = _scanned(course, apart, jax.tree.map(in_blocks, passing), first)
    return Bounds(*(np.asarray(values).reshape(-1, *values.shape[2:])[:count] for values in bounds))


@functools.partial(jax.jit)
def _scanned(course: Course, apart: Apart, passing: Passing, first: First) -> Any:
    """A block's samples one after the other, after the effect of all earlier inputs is summed for the whole block.

    So the long responses are read once a block, as a product of matrices, and at each sample only their first lags.
    """
    _, n, j, length = apart.kernels[0].shape
    short = min(BLOCK, length)
    beginnings = tuple(kernel[..., -short:] for kernel in apart.kernels)
    windows = jnp.arange(BLOCK)[:, None] + 1 + jnp.arange(length)[None]

    def before_it(kernel: Any, history: Any) -> Any:
        """Of all that came in before the block, at each of its samples; what comes in within it is not yet known."""
        padding = jnp.zeros((n, j, BLOCK))
        windowed = jnp.concatenate([history, padding], axis=-1)[..., windows]
        return jnp.einsum("onjl,njbl->bonj", kernel, windowed)

    def pushed(acceleration: Any, stray: Any) -> tuple[Any, Any]:
        strayed = apart.kappa * stray[:, None]
        moved = acceleration + strayed
        others = apart.coupling @ jnp.max((1.0 + apart.spread) * moved, axis=1)
        return apart.spread * moved + others[:, None] + strayed, moved + others[:, None]

    def step(carry: Any, at: Any) -> Any:
        begun, recent, most, carried = carry
        at, olds = at

        def past(old: Any, kernel: Any, window: Any, tail: Any, largest: Any) -> Any:
            return old + jnp.sum(kernel[..., :-1] * window[..., 1:], axis=-1) + tail * largest

        parts = zip(olds, beginnings, recent, apart.tails, most, strict=True)
        answers = Answers(
            before=tuple(past(*arrays) for arrays in parts),
            newest=lambda kind, value: apart.kernels[kind][..., -1] * value,
            pushed=lambda acceleration: pushed(acceleration, at.stray),
        )
        carried, entered, bounds = sampled(course, first, at, begun, carried, answers)
        recent = tuple(_shifted(arrays, new[..., None]) for arrays, new in zip(recent, entered, strict=True))
        most = tuple(jnp.maximum(apart.fading * old, new) for old, new in zip(most, entered, strict=True))
        return (jnp.array(True), recent, most, carried), (entered, bounds)

    def block(carry: Any, ats: Any) -> Any:
        begun, histories, most, carried = carry
        olds = tuple(before_it(*arrays) for arrays in zip(apart.kernels, histories, strict=True))
        recent = (jnp.zeros((n, j, short)),) * 3
        inner = (begun, recent, most, carried)
        (begun, _, most, carried), (entered, bounds) = jax.lax.scan(step, inner, (ats, olds))
        histories = tuple(
            _shifted(arrays, jnp.moveaxis(new, 0, -1)) for arrays, new in zip(histories, entered, strict=True)
        )
        return (begun, histories, most, carried), bounds

    history, nil = jnp.zeros((n, j, length)), jnp.zeros((n, j))
    at_first = carried_at_first(jax.tree.map(lambda arrays: arrays[0], passing), first, j)
    return jax.lax.scan(block, (jnp.array(False), (history,) * 3, (nil,) * 3, at_first), passing)[1]


def _shifted(history: Any, new: Any) -> Any:
    """The history with new values appended, of the same length."""
    return jnp.concatenate([history, new], axis=-1)[..., -history.shape[-1] :]
