"""Whether the log of a run fits into memory, before the run."""

from __future__ import annotations

import math

import equinox as eqx
import jax

from slidax._errors import DefinitionError
from slidax._types import State

from .loop import Loop
from .rollout import begin, sample

MOST_BYTES = 10**9
"""Of a log; while it is made, twice as much is taken."""

SMALL = 200_000
"""Rows that fit whatever is in them, so that only long runs are looked at."""


def require_room(loop: Loop, state0: State, rows: int) -> None:
    """Raises DefinitionError if the log of a run would be too large, with its size and a remedy.

    - `loop`: what is run.
    - `state0`: the first state.
    - `rows`: samples that are logged.
    """
    if rows <= SMALL:
        return
    line = eqx.filter_eval_shape(lambda: sample(loop, begin(loop, state0)[0])[1])
    size = rows * sum(math.prod(leaf.shape) * leaf.dtype.itemsize for leaf in jax.tree.leaves(line))
    if size > MOST_BYTES:
        raise DefinitionError(
            f"the log of {rows} samples would take {size / 1e9:.3g} GB, at most {MOST_BYTES / 1e9:g} GB are kept: "
            f"log one in {math.ceil(size / MOST_BYTES)} times as many (`log_every`), or none"
        )
