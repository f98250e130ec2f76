"""Cause: the law's delay differs from the true one."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from ..cause import AbstractCause, Finding, Remedy
from ..record import Record
from ..seen import as_seen

GAIN = 0.08
"""The share of the unexplained torque that another delay must explain, to be believed."""

APART = 0.9
"""Periods by which a delay must be off, to be named: friction looks like three quarters of one."""


class Delay(AbstractCause):
    """The torque shows in the measured motion later than the law predicts."""

    name: ClassVar[str] = "delay"

    def finding(self, record: Record) -> Finding | None:
        estimate, believed = as_seen(record), float(record.law.delay)
        if not estimate.delay_gain > GAIN or estimate.delay - believed < APART:
            return None
        loops = [loop for loop in record.loops if loop is not None]
        radius = max((loop.radius(1.0, estimate.delay) for loop in loops), default=1.0)
        as_told = max((loop.radius() for loop in loops), default=0.0)
        evidence = (
            f"a torque shows in what is measured {estimate.delay:g} periods after it is decided, and the law is told "
            f"{believed:g}; its loop then has the modulus {radius:.3f}, in place of {as_told:.3f}"
        )
        return Finding(
            name=self.name,
            joint=None,
            weight=0.96 if radius >= 0.995 else 0.5,
            evidence=evidence,
            numbers={"seen": estimate.delay, "believed": believed, "radius": radius},
            remedies=[
                Remedy("tell the law the delay", {"scheme.sampled_data.delay": delay})
                for delay in dict.fromkeys((float(np.ceil(estimate.delay)), float(np.floor(estimate.delay))))
            ],
        )
