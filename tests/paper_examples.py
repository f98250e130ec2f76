"""The paper's two examples, built by hand from the spec's tables."""

from __future__ import annotations

from typing import Any

import jax.numpy as jnp
import numpy as np

from slidax.arms import Scara, TwoLink
from slidax.core.types import State
from slidax.law import FixedTime, SlidingMode, UncertaintyBound, cftsmppc
from slidax.motions import ExponentialSum, Sinusoid
from slidax.plant import AbstractDisturbance, Constant, Harmonic
from slidax.simulation import Plant

TWO_LINK = TwoLink([1.0, 0.8], [0.5, 1.5], [5.0, 5.0], 9.8)
TWO_LINK_NOMINAL = TwoLink([1.0, 0.8], [0.6, 1.8], [6.0, 6.0], 9.8)
SCARA = Scara([0.3, 0.4], [2.0, 2.0, 1.0], 9.8)

MOTION_4_1 = ExponentialSum([1.25, 1.25], [[-1.4, 1.0], [0.35, -0.25]], [1.0, 4.0])
MOTION_4_2 = Sinusoid([0.0, 0.0, 1.0], [1.0, 1.5, 0.5], np.pi / 5, [0.0, np.pi / 2, 0.0])

DISTURBANCE_4_1 = Harmonic([2.0, 1.0], [1.0, 2.0], [0.0, np.pi / 2]) + Harmonic([0.5, 0.5], 200 * np.pi)
DISTURBANCE_4_2 = Harmonic([1.0, 2.0, 2.0], 1.0, [0.0, np.pi / 2, 0.0]) + Constant([1.0, 0.5, 1.0])

START_4_1 = State(q=jnp.array([-0.4, 2.5]), dq=jnp.zeros(2))
START_4_2 = State(q=jnp.array([0.5, 1.2, 0.5]), dq=jnp.zeros(3))

ENVELOPE_4_1 = FixedTime([0.8, 0.6], [0.002, 0.002], [5.0, 6.0], 2.01)
ENVELOPE_4_2 = FixedTime(1.2, 0.002, [5.0, 6.0, 7.0], 2.01)


def law_4_1(nominal: TwoLink = TWO_LINK_NOMINAL, **changes: Any) -> SlidingMode:
    """The law of Example 4.1, Table 1; `changes` go to `cftsmppc`."""
    bound = UncertaintyBound(inverse_inertia_min=0.09, inverse_inertia_max=0.2, b0=12.0, b1=2.2, b2=2.8, margin=1.0)
    parts: dict[str, Any] = {"performance": ENVELOPE_4_1, "overshoot": 0.2, "bound": bound}
    return cftsmppc(nominal, **(parts | changes))


def law_4_2(**changes: Any) -> SlidingMode:
    """The law of Example 4.2, Table 2; `changes` go to `cftsmppc`."""
    bound = UncertaintyBound(inverse_inertia_min=0.9, inverse_inertia_max=1.1, b0=12.0, b1=2.2, b2=2.8, margin=1.0)
    parts: dict[str, Any] = {"performance": ENVELOPE_4_2, "overshoot": 0.2, "bound": bound}
    return cftsmppc(SCARA, **(parts | changes))


def plant_4_1(disturbance: AbstractDisturbance | None = None) -> Plant:
    """The plant of Example 4.1, with its own disturbance unless another is given."""
    return Plant(TWO_LINK, DISTURBANCE_4_1 if disturbance is None else disturbance)


def plant_4_2(disturbance: AbstractDisturbance | None = None) -> Plant:
    """The plant of Example 4.2, with its own disturbance unless another is given."""
    return Plant(SCARA, DISTURBANCE_4_2 if disturbance is None else disturbance)
