"""The joints each by itself: what moves one of them with another is a push that only its size is known of."""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from .padded import padded
from .propagation import Answers, Bounds, Course, First, Passing, carried_at_first, sampled


@dataclass(frozen=True)
class Apart:
    """The loops of the joints, each for some κ; units of periods.

    - `kernels`: sizes of responses to pushes, places and changes of place, the newest last [9 n j L] each.
    - `tails`: what is older does at most, of each, times the largest of it, faded.
    - `fading`: a period's share of that [n j].
    - `spread`: `|κ(t)/κ - 1|` at most, for each κ [n j]; `kappa`: these κ [n j].
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
    """The bounds of all samples, the worst of all κ.

    - `course`, `apart`, `passing`: the loops.
    - `first`: how they begin.
    - `most`: samples that other calls of this kind may have, so that all share one compiled program.
    """
    count = passing.now.shape[0]
    # What comes after the last sample does not touch those before, and is cut off.
    whole = jax.tree.map(lambda one: jnp.asarray(padded(one, most)), passing)
    return Bounds(*(np.asarray(one)[:count] for one in _scanned(course, apart, whole, first)))


@functools.partial(jax.jit)
def _scanned(course: Course, apart: Apart, passing: Passing, first: First) -> Any:
    _, n, j, length = apart.kernels[0].shape

    def past(kernel: Any, tail: Any, history: Any, most: Any, k: Any) -> Any:
        """Of all samples before this; what is of it must be zero until it is known."""
        window = jax.lax.dynamic_slice_in_dim(history, k % length + 1, length, axis=2)
        return jnp.sum(kernel[..., :-1] * window[..., :-1], axis=-1) + tail * most

    def with_newest(history: Any, value: Any, k: Any) -> Any:
        place = k % length
        history = jax.lax.dynamic_update_index_in_dim(history, value, place, axis=2)
        return jax.lax.dynamic_update_index_in_dim(history, value, place + length, axis=2)

    def step(carry: Any, at: Passing) -> Any:
        k, histories, most, carried = carry

        def pushed(acceleration: Any) -> tuple[Any, Any]:
            strayed = apart.kappa * at.stray[:, None]
            moved = acceleration + strayed
            others = apart.coupling @ jnp.max((1.0 + apart.spread) * moved, axis=1)
            return apart.spread * moved + others[:, None] + strayed, moved + others[:, None]

        answers = Answers(
            before=tuple(past(*one, k) for one in zip(apart.kernels, apart.tails, histories, most, strict=True)),
            newest=lambda kind, value: apart.kernels[kind][..., -1] * value,
            pushed=pushed,
        )
        carried, entered, found = sampled(course, first, at, k > 0, carried, answers)
        histories = tuple(with_newest(one, new, k) for one, new in zip(histories, entered, strict=True))
        most = tuple(jnp.maximum(apart.fading * old, new) for old, new in zip(most, entered, strict=True))
        return (k + 1, histories, most, carried), found

    # Each sample is written twice, a length apart, so that those before it always lie side by side.
    history, nil = jnp.zeros((n, j, 2 * length)), jnp.zeros((n, j))
    carry = (0, (history,) * 3, (nil,) * 3, carried_at_first(passing, first, j))
    return jax.lax.scan(step, carry, passing)[1]
