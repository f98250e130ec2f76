"""How far the arm may be from its reference, and how fast it may move away from it."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np

from slidax._types import Scalar
from slidax.controllers import SampledData
from slidax.scenarios import Scenario

from .evaluated import Floats


def width_along(scenario: Scenario, t: Floats) -> Floats | None:
    """The larger side of the envelope at times [N n], rad or m; None for a scheme that draws none.

    - `scenario`: whose.
    - `t`: times [N], s.
    """
    law, start = scenario.controller, scenario.state0
    zero = jnp.zeros(())
    memory = law.init(zero, start, scenario.trajectory.reference(zero))
    if law.envelope(zero, memory) is None:
        return None

    def side(t: Scalar) -> jax.Array:
        envelope = law.envelope(t, memory)
        assert envelope is not None
        return jnp.maximum(-envelope.lower, envelope.upper)

    width = np.asarray(jax.jit(jax.vmap(side))(jnp.asarray(t)))
    return np.broadcast_to(width, (len(t), law.joints))


def speed_within(scenario: Scenario, width: Floats) -> Floats:
    """The largest |ė| with which e and the led error `y = e + c ė` are both in the envelope: `2 ρ/c`, [N n].

    For a law that does not plan c is its period, which says little.

    - `scenario`: whose law, with `c = H - h/2`.
    - `width`: of the envelope [N n].
    """
    law = scenario.controller
    h = scenario.period
    horizon = float(law.horizon) if isinstance(law, SampledData) and law.horizon is not None else h
    return 2.0 * width / (horizon - 0.5 * h)
