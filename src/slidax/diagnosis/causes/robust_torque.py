"""Cause: the model's error exceeds the robust torque u."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np

from ..cause import AbstractCause, Finding, Remedy
from ..record import Record

COVER_SPARE = 1.5
"""Beyond the largest torque that the model was seen to lack."""


class RobustTorque(AbstractCause):
    """The law makes up for `‖M0 w‖ <= u`, and w is at that limit when the run leaves its envelope."""

    name: ClassVar[str] = "robust_torque"

    def finding(self, record: Record) -> Finding | None:
        if "u" not in record.signals or record.signals["u"].ndim != 1:
            return None
        u = record.signals["u"][record.before]
        share = float(np.mean(np.linalg.norm(record.lumped[record.before], axis=1) >= 0.99 * u))
        if share < 0.3:
            return None
        lacks = float(np.percentile(np.linalg.norm(record.unexplained[: record.left + 1], axis=1), 99))
        covers = float(np.median(u))
        evidence = (
            f"the estimate is held back by u in {share:.0%} of the samples before: the model lacks up to "
            f"{lacks:.3g} N m, "
            f"and u covers {covers:.3g} N m"
        )
        return Finding(
            name=self.name,
            joint=None,
            weight=0.4 + 0.4 * share * min(1.0, lacks / max(covers, 1e-9)),
            evidence=evidence,
            numbers={"share": share, "u": covers, "needed": lacks},
            remedies=_cover_remedies(record, covers, lacks),
        )


def _cover_remedies(record: Record, covers: float, lacks: float) -> list[Remedy]:
    bound: Any = getattr(record.scenario.description.scheme, "bound", None)
    # A value that the file leaves out was computed for the arm, and is in the law.
    bound_of_law: Any = getattr(record.law.step, "bound", None)
    remedies = []
    for factor in (1.0, 2.0, 4.0):
        more = factor * max(COVER_SPARE * lacks - covers, 0.5 * covers)
        for name in ("margin", "size"):
            if hasattr(bound, name):
                now = getattr(bound, name)
                value = float(f"{float(getattr(bound_of_law, name) if now is None else now) + more:.3g}")
                remedies.append(Remedy("let u cover it", {f"scheme.bound.{name}": value}))
    return remedies
