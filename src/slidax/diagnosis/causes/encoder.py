"""Cause: encoders too coarse for the envelope, or for the drives."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np

from ..cause import AbstractCause, Finding, Remedy
from ..record import Record
from ..seen import resolution

COARSE = 0.25
"""Of the room in the envelope that one step of the encoders may be: a velocity is found from many of them."""


class Encoder(AbstractCause):
    """A step of the encoders is a good part of the envelope's room, or their noise alone needs the drives' rate."""

    name: ClassVar[str] = "encoder"

    def finding(self, record: Record) -> Finding | None:
        steps = resolution(record.q)
        ratio, noise = steps / record.room, noise_of(record)
        joint = int(np.argmax(np.maximum(ratio / COARSE, noise)))
        if ratio[joint] < COARSE and noise[joint] < 1.0:
            return None
        unit = record.units[joint]
        evidence = (
            f"{record.named(joint)}: its encoder has steps of {steps[joint]:.2g} {unit}, {ratio[joint]:.2g} of the "
            f"{record.room[joint]:.2g} {unit} that the envelope allows; their rounding alone asks for torque "
            "steps of "
            f"{noise[joint]:.2g} times the rate limit"
        )
        numbers = {"resolution": float(steps[joint]), "ratio": float(ratio[joint]), "noise": float(noise[joint])}
        weight = 0.98 if ratio[joint] >= COARSE else min(0.4 + 0.1 * float(noise[joint]), 0.75)
        return Finding(self.name, joint, weight, evidence, numbers, _encoder_remedies(record, float(np.max(steps))))


def noise_of(record: Record) -> np.ndarray:
    """Three standard deviations of the torque's steps from the encoders' rounding, over the rate limit [n]."""
    mass = np.einsum("kii->ki", record.mass_and_bias[0]).mean(axis=0)
    steps, noise = resolution(record.q), np.zeros(record.joints)
    for joint, loop in enumerate(record.loops):
        if loop is not None and steps[joint] > 0 and np.isfinite(record.rate_limits[joint]):
            step = loop.noise(steps[joint] ** 2 / 12.0)[1] * mass[joint]
            noise[joint] = 3.0 * step / (record.rate_limits[joint] * record.period)
    return noise


def _encoder_remedies(record: Record, step: float) -> list[Remedy]:
    scheme: Any = record.scenario.description.scheme
    final = np.asarray(scheme.transformation.performance.final)
    side = record.room / np.broadcast_to(final, record.joints)
    remedies = []
    for times in (4.0, 8.0):
        wider = np.maximum(final, times * step / np.min(side))
        value = [float(f"{radius:.2g}") for radius in np.atleast_1d(wider)]
        path = "scheme.transformation.performance.final"
        remedies.append(Remedy("a final radius that they can resolve", {path: value if final.ndim else value[0]}))
    for part in (0.1, 0.01):
        finer = float(f"{part * step:.2g}")
        remedies.append(Remedy(f"encoders with steps of {finer:g}", {"sensor.resolution": finer}))
    return remedies
