"""Many laws of one kind in one compiled loop."""

from collections.abc import Callable, Sequence
from typing import Any

import equinox as eqx
import jax
import numpy as np

from slidax.simulation import Run, Stepping, simulate_batch


def simulated(
    laws: Sequence[Any],
    values: Any,
    parts: Callable[[Any, Any], Any],
    *,
    t1: float,
    stepping: Stepping,
    log_every: int = 1,
) -> Run:
    """Return the runs of all cases of all laws, those of the first law first."""
    numbers, rest = eqx.partition(laws[0], eqx.is_array)
    form = jax.tree.structure(numbers)
    each = zip(*(jax.tree.leaves(eqx.filter(law, eqx.is_array)) for law in laws), strict=True)
    cases = jax.tree.leaves(values)[0].shape[1]
    stacked = [np.repeat(np.stack([np.asarray(leaf) for leaf in leaves]), cases, axis=0) for leaves in each]
    flat = jax.tree.map(lambda leaf: np.reshape(leaf, (-1, *np.shape(leaf)[2:])), values)

    def define(case: Any) -> Any:
        leaves, own = case
        return parts(eqx.combine(jax.tree.unflatten(form, leaves), rest), own)

    return simulate_batch(define, (stacked, flat), t1=t1, stepping=stepping, log_every=log_every, threads=1)
