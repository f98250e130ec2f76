"""Size limit of a run's log, checked before the run."""

from __future__ import annotations

import math

import equinox as eqx
import jax

from slidax._errors import DefinitionError
from slidax._types import State

from .loop import Loop
from .rollout import begin, sample

MOST_BYTES = 10**9
"""Largest log; twice as much is needed while the log is made."""

SMALL = 200_000
"""Rows that always fit: only longer logs are checked."""


def require_room(loop: Loop, state0: State, rows: int) -> None:
    """Raise a DefinitionError if a log with so many rows would be too large."""
    if rows <= SMALL:
        return
    line = eqx.filter_eval_shape(lambda: sample(loop, begin(loop, state0)[0])[1])
    size = rows * sum(math.prod(leaf.shape) * leaf.dtype.itemsize for leaf in jax.tree.leaves(line))
    if size > MOST_BYTES:
        raise DefinitionError(
            f"the log of {rows} samples would take {size / 1e9:.3g} GB; the limit is {MOST_BYTES / 1e9:g} GB: "
            f"log one in {math.ceil(size / MOST_BYTES)} times as many (`log_every`), or none"
        )
