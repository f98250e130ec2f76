"""Fourier series that begin and end at rest."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .regressor import Motion


@dataclass(frozen=True)
class Fourier:
    """`q(t) = Σ_k a_k cos(kωt) + b_k sin(kωt)`, with velocity and acceleration 0 at t = 0.

    - `period`: 2π/ω [s].
    - `harmonics`: K, how many multiples of ω there are.
    """

    period: float
    harmonics: int

    def random(self, rng: np.random.Generator, joints: int) -> np.ndarray:
        """Random coefficients, [n 2K + 1]: a, b, and one number more that says about where to move.

        - `joints`: n.
        """
        return rng.normal(size=(joints, 2 * self.harmonics + 1))

    def motion(self, coefficients: np.ndarray, points: int) -> Motion:
        """The series and its derivatives at even times of one period, each [points n].

        The coefficients are projected on those with `Σ k b_k = 0` and `Σ k² a_k = 0`, and the higher ones are made
        smaller, so that accelerations of all harmonics are about alike.

        - `coefficients`: [n 2K + 1].
        - `points`: how many.
        """
        count = np.arange(1, self.harmonics + 1)
        # As shares of acceleration, in which the condition on a is Σ a = 0, and that on b Σ b/k = 0.
        a, b = coefficients[:, : self.harmonics], coefficients[:, self.harmonics : 2 * self.harmonics]
        a = a - a.mean(axis=1, keepdims=True)
        b = b - (b @ (1.0 / count))[:, None] / count / np.sum(1.0 / count**2)
        omega = 2.0 * np.pi / self.period
        angle = omega * np.outer(np.arange(points) * self.period / points, count)
        cosine, sine = np.cos(angle), np.sin(angle)
        rate = omega * count
        return Motion(
            q=(cosine / rate**2) @ a.T + (sine / rate**2) @ b.T,
            dq=(-sine / rate) @ a.T + (cosine / rate) @ b.T,
            ddq=-cosine @ a.T - sine @ b.T,
        )
