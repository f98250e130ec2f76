"""Cause: a sampling period too long for disturbance and envelope, by the loop-rate rule."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from ..cause import AbstractCause, Finding, Remedy
from ..record import Record


class Period(AbstractCause):
    """`(H + D h)² w̄ < ϑ ρ∞` does not hold (docs/loop-rate.md)."""

    name: ClassVar[str] = "period"

    def finding(self, record: Record) -> Finding | None:
        age = record.horizon + float(record.law.delay) * record.period
        reached = age**2 * record.missed
        ratio = reached / record.room
        joint = int(np.argmax(ratio))
        if ratio[joint] < 1.0:
            return None
        unit = record.units[joint]
        evidence = (
            f"{record.named(joint)}: at a period of {1e3 * record.period:g} ms the estimate misses up to "
            f"{record.missed[joint]:.3g} {unit}/s², which pushes the error (H + D h)² w = "
            f"{reached[joint]:.2g} {unit} far, "
            f"and the envelope allows {record.room[joint]:.2g} {unit}"
        )
        # A slow loop is the reason by itself; in a fast one, the rule fails since something else does.
        alone = np.clip(np.log10(record.period / 1e-3), 0.0, 1.0)
        return Finding(
            name=self.name,
            joint=joint,
            weight=0.4 + 0.3 * float(alone),
            evidence=evidence,
            numbers={
                "ratio": float(ratio[joint]),
                "missed": float(record.missed[joint]),
                "horizon": record.horizon,
                "period": record.period,
            },
            remedies=[_shorter(record, factor) for factor in (2, 4, 8)],
        )


def _shorter(record: Record, factor: int) -> Remedy:
    simulation = record.scenario.description.simulation
    block = record.scenario.description.scheme.sampled_data
    changes: dict[str, float | int] = {
        "simulation.period": float(f"{simulation.period / factor:.6g}"),
        "simulation.substeps": max(1, simulation.substeps // factor),
    }
    if block is not None and block.horizon is not None:
        changes["scheme.sampled_data.horizon"] = float(f"{block.horizon / factor:.6g}")
    return Remedy(f"a period of {1e3 * simulation.period / factor:g} ms, and a horizon that goes with it", changes)
