"""Cause: an estimator that makes the loop unstable, or is too slow or too fast for it."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np

from slidax.estimators import Kalman

from ..cause import AbstractCause, Finding, Remedy
from ..record import Record
from .encoder import noise_of

SLOW, FAST = 0.25, 4.0
"""ω H of an estimator that is slower or faster than a loop with that horizon can use; the built-in scenarios have .6 to
3."""

NOISY = 0.5
"""Of the torque's rate limit that noise may ask for, before a fast estimator is too fast."""

ESTIMATOR = "scheme.sampled_data.estimator"


class Estimator(AbstractCause):
    """With the believed inertia and delay the loop is unstable; or ω H of its estimator is far from 1."""

    name: ClassVar[str] = "estimator"

    def finding(self, record: Record) -> Finding | None:
        kind = type(record.law.estimator).__name__
        loops = [loop for loop in record.loops if loop is not None]
        if not loops:
            return self._not_known(record, kind)
        radius = [loop.radius() for loop in loops]
        joint = int(np.argmax(radius))
        if radius[joint] >= 1.0:
            evidence = (
                f"{record.named(joint)}: with exactly the believed inertia and delay, the loop with the "
                f"estimator `{kind}` "
                f"is unstable (modulus {radius[joint]:.3f} a period)"
            )
            numbers = {"radius": radius[joint]}
            return Finding(self.name, joint, 0.97, evidence, numbers, _estimator_remedies(record))
        pace = [loop.bandwidth * record.horizon for loop in loops]
        slowest, fastest = int(np.argmin(pace)), int(np.argmax(pace))
        if pace[slowest] < SLOW and isinstance(record.law.estimator, Kalman):
            bandwidth = loops[slowest].bandwidth
            evidence = (
                f"{record.named(slowest)}: the estimator follows at {bandwidth:.3g} rad/s, {pace[slowest]:.2g} of 1/H"
            )
            numbers = {"bandwidth": bandwidth, "pace": pace[slowest]}
            return Finding(self.name, slowest, 0.75, evidence, numbers, _estimator_remedies(record))
        if pace[fastest] > FAST:
            noise = noise_of(record)
            if noise[fastest] < NOISY:
                return None
            bandwidth = loops[fastest].bandwidth
            evidence = (
                f"{record.named(fastest)}: the estimator follows at {bandwidth:.3g} rad/s, "
                f"{pace[fastest]:.2g} times 1/H, "
                f"so that the encoders' rounding alone asks for torque steps of {noise[fastest]:.2g} times "
                "the rate limit"
            )
            numbers = {"bandwidth": bandwidth, "pace": pace[fastest], "noise": float(noise[fastest])}
            return Finding(self.name, fastest, 0.92, evidence, numbers, _estimator_remedies(record))
        return None

    def _not_known(self, record: Record, kind: str) -> Finding | None:
        if record.law.horizon is None:
            return None
        evidence = f"the estimator `{kind}` is not linear, so that its loop cannot be told to be stable"
        return Finding(self.name, None, 0.45, evidence, {}, _estimator_remedies(record))


def _estimator_remedies(record: Record) -> list[Remedy]:
    """Another density, so that ω H is near 1, as ω goes with its sixth root; and the filter as it is by default."""
    block: Any = record.scenario.description.scheme.sampled_data
    remedies = []
    density = getattr(block.estimator, "torque_density", None)
    if isinstance(density, float):
        pace = [loop.bandwidth * record.horizon for loop in record.loops if loop is not None]
        for target in (1.0, 0.6, 1.6):
            value = float(f"{density * (target / np.exp(np.mean(np.log(pace)))) ** 6:.3g}")
            remedies.append(
                Remedy("an estimator as fast as the horizon allows", {f"{ESTIMATOR}.torque_density": value})
            )
    remedies.append(Remedy("the Kalman filter with its usual density", {ESTIMATOR: {"kind": "kalman"}}))
    return remedies
