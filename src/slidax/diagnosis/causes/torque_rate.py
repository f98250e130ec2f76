"""Cause: torque rate limits below the motion's demand."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from ..cause import AbstractCause, Finding, Remedy
from ..record import Record
from .motion import slower
from .sheet import data_sheet
from .torque import REACHED


class TorqueRate(AbstractCause):
    """A joint's torque changes at its limit when the run leaves its envelope."""

    name: ClassVar[str] = "torque_rate"

    def finding(self, record: Record) -> Finding | None:
        limits = record.rate_limits
        steps = np.abs(np.diff(record.tau[record.before], axis=0))
        share = np.mean(steps >= REACHED * limits * record.period, axis=0) if len(steps) else np.zeros(record.joints)
        joint = int(np.argmax(share))
        if share[joint] < 0.3:
            return None
        unit = f"{record.torque_unit(joint)}/s"
        evidence = (
            f"{record.named(joint)}: its torque changes at its limit of {limits[joint]:.4g} {unit} in "
            f"{share[joint]:.0%} of the samples before"
        )
        return Finding(
            name=self.name,
            joint=joint,
            weight=0.4 + 0.45 * float(share[joint]),
            evidence=evidence,
            numbers={"share": float(share[joint]), "limit": float(limits[joint])},
            remedies=_rate_remedies(record),
        )


def _rate_remedies(record: Record) -> list[Remedy]:
    limits, sheet = record.rate_limits, data_sheet(record, "torque_rate")
    remedies = []
    if np.any(sheet > limits):
        words = "allow the rate that the arm's data sheet has"
        remedies.append(Remedy(words, {"actuator.rate": np.maximum(sheet, limits).tolist()}))
    remedies += slower(record)
    for factor in (3.0, 10.0, 30.0):
        words = f"take drives that are {factor:g} times as fast"
        remedies.append(Remedy(words, {"actuator.rate": (factor * limits).tolist()}))
    return remedies
