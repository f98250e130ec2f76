"""Logs and axis labels for figures."""

from __future__ import annotations

import numpy as np

from slidax._errors import DefinitionError
from slidax.metrics import short_names
from slidax.simulation import Log, Run

LONGEST = 18
"""Characters of a joint's name at most, for lack of space."""


def log_of(run: Run) -> Log:
    """The log of a `run`.

    Raises DefinitionError if there is none, or it is too short.
    """
    if run.log is None:
        raise DefinitionError("a figure needs the log of its run; simulate with `log_every=10`, not None")
    if np.ndim(run.log.t) != 1:
        raise DefinitionError("a figure shows one run, and this is a batch; take one of its runs first")
    if len(run.log.t) < 2:
        raise DefinitionError(f"a figure needs at least two logged samples; got {len(run.log.t)}; log more of them")
    return run.log


def joint_label(run: Run, joint: int, symbol: str, unit: str) -> str:
    """The axis label of a joint: its name, if it has one, above the symbol with its number.

    - `run`: with the joint.
    - `joint`: index from 0.
    - `symbol`: mathematical text with `%d` for the number.
    - `unit`: of the axis.
    """
    name = short_names(run.joint_names)[joint]
    label = f"${symbol % (joint + 1)}$  [{unit}]"
    if name == f"joint {joint + 1}":
        return label
    shown = name if len(name) <= LONGEST else f"{name[: LONGEST - 1]}…"
    return f"{shown.replace('$', '')}\n{label}"
