"""What a torque does that is computed for another state than the one in which it sets in."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .beside import SPARE, STEP
from .evaluated import Floats
from .motion import Belief, Motion


@dataclass(frozen=True, eq=False)
class Misread:
    """`|M̂⁻¹ (∂(M̂ a + C0 q̇ + G0)/∂q e + ∂(C0 q̇)/∂q̇ ė)|` for predictions that miss q by e and q̇ by ė; `a = q̈ - w*`.

    - `along_q`, `along_dq`: these slopes along a motion, the largest of all beliefs [N n n].
    """

    along_q: Floats
    along_dq: Floats

    @classmethod
    def of(cls, beliefs: Sequence[Belief], motion: Motion, push: Floats) -> Misread:
        """The slopes by central differences.

        - `beliefs`: what the law may believe, all of one arm of which they learnt.
        - `motion`: along which.
        - `push`: bounds of |w*| [N n], which the command makes up for.
        """
        n, first = motion.joints, beliefs[0]
        slopes = np.zeros((2, *motion.q.shape, n))
        known, _ = first.at_first(motion.t, motion.q, motion.dq)
        inverse = [np.linalg.inv(belief.learnt(known, motion.t)) for belief in beliefs]
        for joint in range(n):
            step = np.where(np.arange(n) == joint, STEP, 0.0)
            for k, way in enumerate(((step, 0.0 * step), (0.0 * step, step))):
                there = [motion.beside(sign * way[0], sign * way[1]) for sign in (1.0, -1.0)]
                (most, above), (least, below) = (first.at_first(one.t, one.q, one.dq) for one in there)
                for belief, back in zip(beliefs, inverse, strict=True):
                    moved = belief.learnt(most, motion.t) - belief.learnt(least, motion.t)
                    torque = np.einsum("kij,kj->ki", moved, motion.ddq) + (above - below)
                    slope = np.abs(np.einsum("kij,kj->ki", back, torque))
                    slope += np.einsum("kij,kj->ki", np.abs(back @ moved), push)
                    slope /= 2.0 * STEP
                    slopes[k, ..., joint] = np.maximum(slopes[k, ..., joint], (1.0 + SPARE) * slope)
        return cls(slopes[0], slopes[1])

    def __call__(self, radius: Floats, speed: Floats) -> Floats:
        """The bound [N n], rad/s² or m/s².

        - `radius`: what a prediction misses of q [N n], rad or m.
        - `speed`: of q̇ [N n], rad/s or m/s.
        """
        return np.einsum("kij,kj->ki", self.along_q, radius) + np.einsum("kij,kj->ki", self.along_dq, speed)
