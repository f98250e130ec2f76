"""Ratios of nominal to true inertia: the range of κ, and the coupling between joints."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from slidax.simulation import Plant

from ..each import Floats
from .motion import Belief, Motion, needed

INSTANTS = 200
"""Instants of the motion at which ratios are evaluated."""

KEPT = 24
"""Number of these instants at which K of each member is returned."""


def ratios(
    plants: Sequence[Plant], beliefs: Sequence[Belief], motion: Motion, kept: int = KEPT
) -> tuple[Floats, Floats, Floats]:
    """Return the range of κ, the diagonal of `K = M⁻¹M̂` [2 n], and the largest |K_ij/K_jj| for i ≠ j [n n].

    The third value is K [I n n] of each member at some instants.

    - `beliefs`: the model of each arm.
    - `kept`: number of instants at which K is returned.
    """
    few = motion.every(INSTANTS)
    each: list[Floats] = []
    least = np.full(motion.joints, np.inf)
    most, coupling = -least, np.zeros((motion.joints, motion.joints))
    for plant, belief in zip(plants, beliefs, strict=True):
        believed, _ = belief.mass_and_bias(few.t, few.q, few.dq)
        ratio = np.linalg.solve(needed([plant], few)[0][0], believed)
        each.append(ratio[:: max(1, len(ratio) // kept)])
        own = np.diagonal(ratio, axis1=1, axis2=2)
        least, most = np.minimum(least, own.min(axis=0)), np.maximum(most, own.max(axis=0))
        coupling = np.maximum(coupling, np.abs(ratio / own[:, None, :]).max(axis=0))
    np.fill_diagonal(coupling, 0.0)
    return np.array([least, most]), coupling, np.concatenate(each)
