"""Arms and their postures for tests of kinematics."""

from __future__ import annotations

import numpy as np

from slidax import arms
from slidax.arms import Articulated

SIX, SEVEN = "ur5e", "panda"


def home(name: str) -> np.ndarray:
    return np.asarray(arms.built_in_arm(name).home, float)


def drawn(arm: Articulated, seed: int, count: int, room: float = 0.1) -> np.ndarray:
    """Postures within the limits, and not near them."""
    low, high = np.maximum(arm.limits.lower, -np.pi), np.minimum(arm.limits.upper, np.pi)
    share = np.random.default_rng(seed).uniform(room, 1 - room, (count, arm.joints))
    return low + share * (high - low)
