"""The envelope that a scenario's law draws."""

from __future__ import annotations

from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from slidax._types import State
from slidax.scenarios import Scenario

from .each import Each

Floats = NDArray[np.floating[Any]]


def draws_envelope(scenario: Scenario) -> bool:
    """Whether the law draws one.

    - `scenario`: whose law.
    """
    law = scenario.controller
    return eqx.filter_eval_shape(lambda: _at(scenario, law.joints)) is not None


def envelope_of(scenario: Scenario, times: Floats) -> tuple[Floats, Floats] | None:
    """Its lower and upper bounds for the scenario's own start, [N n]; None for a law that draws none.

    - `scenario`: whose law.
    - `times`: when [N], s.
    """
    if not draws_envelope(scenario):
        return None
    law, state0 = scenario.controller, scenario.state0

    def at(t: Any, q: Any, dq: Any) -> Any:
        memory = law.init(jnp.zeros(()), State(q=q, dq=dq), scenario.trajectory.reference(jnp.zeros(())))
        found = law.envelope(t, memory)
        assert found is not None
        return found.lower, found.upper

    rows = len(times)
    lower, upper = Each(at)(
        times, *(np.broadcast_to(np.asarray(one), (rows, law.joints)) for one in (state0.q, state0.dq))
    )
    return lower, upper


def _at(scenario: Scenario, joints: int) -> Any:
    t, law = jnp.zeros(()), scenario.controller
    reference = scenario.trajectory.reference(t)
    return law.envelope(t, law.init(t, State(q=jnp.zeros(joints), dq=jnp.zeros(joints)), reference))
