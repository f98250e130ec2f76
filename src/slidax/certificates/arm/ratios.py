"""How far the believed inertia is from the true one: the range of κ, and how the joints move each other."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from slidax.simulation import Plant

from .evaluated import Floats
from .motion import Belief, Motion, needed

INSTANTS = 200
"""Of the motion, at which is looked."""

KEPT = 24
"""Of these instants whose K of each member are kept."""


def ratios(
    plants: Sequence[Plant], beliefs: Sequence[Belief], motion: Motion, kept: int = KEPT
) -> tuple[Floats, Floats, Floats]:
    """The range of the diagonal of `K = M⁻¹M̂` [2 n], and the largest |K_ij/K_jj| for i ≠ j [n n], along a motion.

    Last some K as they are [I n n]: of each member at some instants.

    - `plants`: true arms.
    - `beliefs`: what each of them is believed to be.
    - `motion`: of which some instants are looked at.
    - `kept`: of how many of them K is given.
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
