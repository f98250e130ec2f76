"""What pictures ask of a run."""

from __future__ import annotations

import numpy as np

from slidax._errors import DefinitionError
from slidax.simulation import Log, Run


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


def torque_unit(joint_unit: str) -> str:
    """`N m` for a joint measured in rad, `N` for one measured in m.

    - `joint_unit`: the unit of the joint's position.
    """
    return "N m" if joint_unit == "rad" else "N"
