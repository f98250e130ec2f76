"""What pictures ask of a run."""

from __future__ import annotations

import numpy as np

from slidax._errors import DefinitionError
from slidax.metrics import short_names
from slidax.simulation import Log, Run

LONGEST = 18
"""No more characters of a joint's name fit beside its panel."""


def log_of(run: Run) -> Log:
    """The log of a run.

    - `run`: a finished run.

    Raises DefinitionError if it has none, or an empty one.
    """
    if run.log is None:
        raise DefinitionError("a figure needs the log of its run; simulate with `log_every=10`, not None")
    if np.ndim(run.log.t) != 1:
        raise DefinitionError("a figure shows one run, and this is a batch; take one of its runs first")
    if len(run.log.t) < 2:
        raise DefinitionError(f"a figure needs at least two logged samples; got {len(run.log.t)}; log more of them")
    return run.log


def joint_label(run: Run, joint: int, symbol: str, unit: str) -> str:
    """The label of one joint's axis: the symbol with the joint's number, below the joint's name if it has one.

    - `run`: whose joint.
    - `joint`: its number, from 0.
    - `symbol`: as mathematics, with `%d` for the number.
    - `unit`: of the axis.
    """
    name = short_names(run.joint_names)[joint]
    label = f"${symbol % (joint + 1)}$  [{unit}]"
    if name == f"joint {joint + 1}":
        return label
    shown = name if len(name) <= LONGEST else f"{name[: LONGEST - 1]}…"
    return f"{shown.replace('$', '')}\n{label}"
