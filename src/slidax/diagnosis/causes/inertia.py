"""Cause: a joint's true inertia differs from the law's model."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np

from ..cause import AbstractCause, Finding, Remedy
from ..record import Record
from ..seen import Seen, as_seen, believed_inertia

SURE = 0.85
"""The share of a joint's torque in the band that its inertia must explain."""

ADAPTATION = "adaptation"
"""The field of `sampled_data` that says whether and how the law learns its arm's inertia, where there is one."""

EDGE = 0.995
"""The largest modulus of a loop that is as good as unstable: it takes .2 s at 1 kHz to forget half of an error."""


class Inertia(AbstractCause):
    """The loop with the inertia that is seen is unstable, or nearly so, and with the believed one it is not."""

    name: ClassVar[str] = "inertia"

    def finding(self, record: Record) -> Finding | None:
        estimate = as_seen(record)
        believed = believed_inertia(record, estimate)
        kappa = np.divide(believed, estimate.inertia, where=estimate.inertia > 0, out=np.full_like(believed, np.nan))
        told = np.isfinite(kappa) & (estimate.coherence > SURE)
        radius = np.array(
            [
                loop.radius(kappa[joint]) if told[joint] and loop is not None else 0.0
                for joint, loop in enumerate(record.loops)
            ]
        )
        if not radius.size or radius.max() < EDGE:
            return None
        beyond = np.where(radius >= EDGE, np.abs(np.log(np.where(told, kappa, 1.0))), 0.0)
        joint = int(np.argmax(beyond))
        loop = record.loops[joint]
        assert loop is not None
        factor = float(1.0 / kappa[joint])
        unit = "kg m²" if record.units[joint] == "rad" else "kg"
        own = believed[joint] - estimate.nominal[joint]
        learnt = "" if record.law.adaptation is None else f", {own:.2g} of it learnt"
        compared = f"is {factor:.2g} times as heavy as" if factor > 1 else f"has {factor:.2g} of the inertia that"
        least, most = loop.stable_range()
        evidence = (
            f"{record.named(joint)}: the arm {compared} the law believes (seen {estimate.inertia[joint]:.3g}, believed "
            f"{believed[joint]:.3g} {unit}{learnt}); its loop bears {1.0 / most:.2g} to {1.0 / least:.2g} times"
        )
        return Finding(
            name=self.name,
            joint=joint,
            weight=0.95 if radius[joint] >= 1.0 else 0.7,
            evidence=evidence,
            numbers={
                "seen": float(estimate.inertia[joint]),
                "believed": float(believed[joint]),
                "nominal": float(estimate.nominal[joint]),
                "kappa": float(kappa[joint]),
                "stable_from": least,
                "stable_to": most,
            },
            remedies=[*_learnt(record), *_told(record, estimate, told)],
        )


def _learnt(record: Record) -> list[Remedy]:
    """Where a law can learn the inertia and its file says null: let it. Here, and nowhere else, is this said."""
    block = record.scenario.description.scheme.sampled_data
    field = {} if block is None else type(block).model_fields
    if ADAPTATION not in field or getattr(block, ADAPTATION) is not None:
        return []
    default = field[ADAPTATION].get_default(call_default_factory=True)
    value: Any = {} if default is None else {"kind": default.kind}
    return [Remedy("let it be learnt: remove `adaptation: null`", {f"scheme.sampled_data.{ADAPTATION}": value})]


def _told(record: Record, estimate: Seen, told: np.ndarray) -> list[Remedy]:
    """The inertia that was seen, as numbers of the nominal arm."""
    robot = record.scenario.description.robot
    nominal: Any = getattr(robot, "nominal", None)
    fields = {} if nominal is None else type(nominal).model_fields
    if "armature" in fields:
        known = np.broadcast_to(np.asarray(record.nominal.armature), record.joints)  # type: ignore[attr-defined]
        change = np.where(told, estimate.inertia - estimate.nominal, 0.0)
        armature = [float(f"{value:.3g}") for value in np.maximum(known + np.nan_to_num(change), 0.0)]
        words = "tell the law what was seen, or find it by `slidax identify`"
        return [Remedy(words, {"robot.nominal.armature": armature})]
    if {"masses", "inertias"} <= fields.keys():
        factor = float(np.exp(np.mean(np.log(1.0 / estimate.kappa[told]))))
        changes = {}
        for name in ("masses", "inertias"):
            values = np.asarray(getattr(record.nominal, name)) * factor
            changes[f"robot.nominal.{name}"] = [float(f"{value:.4g}") for value in np.atleast_1d(values)]
        return [Remedy(f"tell the law {factor:.3g} times the inertia", changes)]
    return []
