"""Paths of the tip."""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from slidax._errors import DefinitionError
from slidax.robots import AbstractRobot
from slidax.simulation import Run


def tip_paths(robot: AbstractRobot, run: Run) -> tuple[np.ndarray, np.ndarray]:
    """Actual and desired tip positions at the logged times, each [k 3], m.

    - `robot`: the arm, for its kinematics.
    - `run`: with a log.

    Raises DefinitionError if the run has no log.
    """
    if run.log is None:
        raise DefinitionError("the path of the tip needs the log of the run; simulate with `log_every=10`, not None")
    places = eqx.filter_jit(eqx.filter_vmap(robot.tip))
    actual, desired = (places(jnp.asarray(q)) for q in (run.log.state.q, run.log.reference.q))
    return np.asarray(actual), np.asarray(desired)
