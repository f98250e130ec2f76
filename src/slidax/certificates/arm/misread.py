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

        - `beliefs`: what the law may believe.
        - `motion`: along which.
        - `push`: bounds of |w*| [N n], which the command makes up for.
        """
        n = motion.joints
        slopes = np.zeros((2, *motion.q.shape, n))
        for belief in beliefs:
            mass, _ = belief.mass_and_bias(motion.t, motion.q, motion.dq)
            for joint in range(n):
                step = np.where(np.arange(n) == joint, STEP, 0.0)
                for k, way in enumerate(((step, 0.0 * step), (0.0 * step, step))):
                    torque, moved = np.zeros_like(motion.q), np.zeros_like(mass)
                    for sign in (1.0, -1.0):
                        there = motion.beside(sign * way[0], sign * way[1])
                        inertia, bias = belief.mass_and_bias(there.t, there.q, there.dq)
                        torque += sign * (np.einsum("kij,kj->ki", inertia, there.ddq) + bias)
                        moved += sign * inertia
                    slope = np.abs(np.linalg.solve(mass, torque[..., None])[..., 0])
                    slope += np.einsum("kij,kj->ki", np.abs(np.linalg.solve(mass, moved)), push)
                    slope /= 2.0 * STEP
                    slopes[k, ..., joint] = np.maximum(slopes[k, ..., joint], (1.0 + SPARE) * slope)
        return cls(slopes[0], slopes[1])

    def __call__(self, radius: Floats, speed: Floats) -> Floats:
        """The bound [N n], rad/s² or m/s².

        - `radius`: what a prediction misses of q [N n], rad or m.
        - `speed`: of q̇ [N n], rad/s or m/s.
        """
        found: Floats = np.einsum("kij,kj->ki", self.along_q, radius) + np.einsum("kij,kj->ki", self.along_dq, speed)
        return found
