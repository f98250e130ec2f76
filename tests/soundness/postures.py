"""The constants of random chains of one to seven joints, in random postures."""

from pathlib import Path

import numpy as np

from slidax.certify.arm import arm_constants
from tests.certify.arm.test_constants import random_arm, worst

from .counted import Counted

STATES = 4000


def judged(folder: Path, seed: int, count: Counted) -> None:
    """Count the postures of one chain by the constant that is closest to being exceeded."""
    robot = random_arm(folder, seed)
    constants, sampled = arm_constants(robot), worst(robot, seed)
    shares = [
        sampled["largest"] / constants.inertia_max,
        constants.inertia_min / sampled["least"],
        float(np.max(sampled["weight"] / np.maximum(constants.weight, 1e-12))),
        sampled["mass_slope"] / max(constants.mass_slope, 1e-12),
        sampled["weight_slope"] / max(constants.weight_slope, 1e-12),
        sampled["coriolis"] / max(constants.coriolis, 1e-12),
    ]
    largest = float(np.max(shares))
    # The postures of a chain count by the worst of them.
    count.kept(np.full(1, largest), robot.joints, f"chain {seed}", slack=1e-9)
    count.cases += STATES - 1
