"""The constants of arms, in every posture that is drawn, of random chains of one to seven joints."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from slidax.certificates.arm import arm_constants
from tests.certificates.arm.test_constants import random_arm, worst

from .counted import Counted

STATES = 4000


def judged(folder: Path, seed: int, count: Counted) -> None:
    """Counts the postures of one chain by the constants that come nearest to being exceeded.

    - `folder`: for its file.
    - `seed`: of the chain and of its postures.
    - `count`: in which they are counted.
    """
    robot = random_arm(folder, seed)
    found, seen = arm_constants(robot), worst(robot, seed)
    shares = [
        seen["largest"] / found.inertia_max,
        found.inertia_min / seen["least"],
        float(np.max(seen["weight"] / np.maximum(found.weight, 1e-12))),
        seen["mass_slope"] / max(found.mass_slope, 1e-12),
        seen["weight_slope"] / max(found.weight_slope, 1e-12),
        seen["coriolis"] / max(found.coriolis, 1e-12),
    ]
    largest = float(np.max(shares))
    # Those of a chain are compared by their worst.
    count.kept(np.full(1, largest), robot.joints, f"chain {seed}", slack=1e-9)
    count.cases += STATES - 1
