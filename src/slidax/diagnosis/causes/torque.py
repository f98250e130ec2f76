"""Cause: torque limits below the motion's demand."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from ..along import along
from ..cause import AbstractCause, Finding, Remedy
from ..record import Record
from .motion import slower
from .sheet import data_sheet

REACHED = 0.999
"""Of a limit: a torque that is so large is at it."""

TORQUE_SPARE = 1.15
"""Beyond what the motion needs, for what the law adds to it."""


class Torque(AbstractCause):
    """A joint's torque is at its limit when the run leaves its envelope."""

    name: ClassVar[str] = "torque"

    def finding(self, record: Record) -> Finding | None:
        share = np.mean(np.abs(record.tau[record.before]) >= REACHED * record.torque_limits, axis=0)
        joint = int(np.argmax(share))
        if share[joint] < 0.1:
            return None
        needed, limit, unit = needed_torque(record), record.torque_limits, record.torque_unit(joint)
        evidence = (
            f"{record.named(joint)}: its torque is at its limit of {limit[joint]:.4g} {unit} in "
            f"{share[joint]:.0%} of the "
            f"samples before; the motion needs up to {needed[joint]:.3g} {unit}"
        )
        weak = needed > limit
        return Finding(
            name=self.name,
            joint=joint,
            weight=(0.5 if weak[joint] else 0.3) + 0.35 * float(share[joint]),
            evidence=evidence,
            numbers={"share": float(share[joint]), "limit": float(limit[joint]), "needed": float(needed[joint])},
            remedies=_torque_remedies(record, needed),
        )


def needed_torque(record: Record) -> np.ndarray:
    """The largest torque of the motion [n], N m or N: the nominal arm's, with what the log shows it to lack."""
    mass, bias = along(record.nominal, record.q_d, record.dq_d)
    wanted = np.einsum("kij,kj->ki", mass, record.ddq_d) + bias
    lacks = np.median(record.unexplained[record.before], axis=0)
    return np.max(np.abs(wanted + lacks), axis=0)


def _torque_remedies(record: Record, needed: np.ndarray) -> list[Remedy]:
    limits, sheet = record.torque_limits, data_sheet(record, "torque")
    remedies = []
    if np.any(sheet > limits):
        words = "allow the torque that the arm's data sheet has"
        remedies.append(Remedy(words, {"actuator.torque": sheet.tolist()}))
    remedies += slower(record)
    for factor in (TORQUE_SPARE, 1.5, 2.0):
        enough = [float(f"{value:.3g}") for value in np.maximum(limits, factor * needed)]
        remedies.append(Remedy("take drives that give what the motion needs", {"actuator.torque": enough}))
    return remedies
