"""Half width of the envelope, and the largest error rate within it."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np

from slidax._types import Scalar
from slidax.controllers import SampledData
from slidax.scenarios import Scenario

from ..each import Floats


def width_along(scenario: Scenario, t: Floats) -> Floats | None:
    """Return the larger side of the envelope at times [N n], rad or m; None for a scheme without an envelope."""
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
    """Return the largest |ė| for which e and the led error `y = e + c ė` are both in the envelope: `2 ρ/c`, [N n].

    For a law without a plan c is its period, so the bound is weak.

    - `scenario`: `c = H - h/2` is its law's.
    - `width`: of the envelope [N n].
    """
    law = scenario.controller
    h = scenario.period
    horizon = float(law.horizon) if isinstance(law, SampledData) and law.horizon is not None else h
    return 2.0 * width / (horizon - 0.5 * h)
