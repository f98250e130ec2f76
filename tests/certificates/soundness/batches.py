"""Many laws of one kind in one compiled loop: their numbers are what varies."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import equinox as eqx
import jax
import numpy as np

from slidax.simulation import Run, Stepping, simulate_batch


def simulated(
    laws: Sequence[Any],
    given: Any,
    parts: Callable[[Any, Any], Any],
    *,
    t1: float,
    stepping: Stepping,
    log_every: int = 1,
) -> Run:
    """The runs of all cases of all laws, those of the first law first.

    - `laws`: that differ in nothing but numbers.
    - `given`: a pytree of arrays, of each law and case [laws cases ...].
    - `parts`: from a law and what is given of one case to its closed loop.
    - `t1`, `stepping`, `log_every`: as in `simulate_batch`.
    """
    numbers, rest = eqx.partition(laws[0], eqx.is_array)
    form = jax.tree.structure(numbers)
    each = zip(*(jax.tree.leaves(eqx.filter(law, eqx.is_array)) for law in laws), strict=True)
    cases = jax.tree.leaves(given)[0].shape[1]
    stacked = [np.repeat(np.stack([np.asarray(one) for one in leaves]), cases, axis=0) for leaves in each]
    flat = jax.tree.map(lambda one: np.reshape(one, (-1, *np.shape(one)[2:])), given)

    def define(one: Any) -> Any:
        leaves, own = one
        return parts(eqx.combine(jax.tree.unflatten(form, leaves), rest), own)

    return simulate_batch(define, (stacked, flat), t1=t1, stepping=stepping, log_every=log_every, threads=1)
