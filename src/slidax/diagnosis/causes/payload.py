"""Cause: a payload beyond the torque limits."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import equinox as eqx
import numpy as np

from slidax._errors import as_array
from slidax.robots import Articulated
from slidax.robots import Payload as Carried

from ..along import along
from ..cause import AbstractCause, Finding, Remedy
from ..filtered import low_passed
from ..record import SLOW, Record
from .sheet import data_sheet
from .torque import REACHED

ARMS = (0.0, 0.2)
"""Two places of a kilogram along the tip's axis [m]: its unknown place is between or near them."""

SURE = 4.0
"""Standard errors that a mass must be, to be believed."""

AROUND = (0.2, 2.0)
"""Time after leaving the envelope that still shows a payload carried all along, and one picked up [s]."""

LEAST = 0.2
"""The least mass that is named [kg]."""


@dataclass(frozen=True)
class Weighed:
    """Payload beyond the one in the law's model.

    - `mass`: [kg], with its standard error `spread`.
    - `explained`: the share of what the model lacks that it explains beyond friction and the arm's own mass.
    - `most`: the largest mass with which the drives can follow the motion [kg].
    """

    mass: float
    spread: float
    explained: float
    most: float


class Payload(AbstractCause):
    """The torque missing from the model is that of a payload, and exceeds the torque limits."""

    name: ClassVar[str] = "payload"

    def finding(self, record: Record) -> Finding | None:
        if not isinstance(record.nominal, Articulated) or not np.any(np.isfinite(record.torque_limits)):
            return None
        estimate = weighed(record, record.nominal)
        if estimate.mass < max(SURE * estimate.spread, LEAST) or estimate.explained < 0.3:
            return None
        # From where it left on: before, u or the rate may have held the torque back.
        share = np.mean(np.abs(record.tau[record.before.start :]) >= REACHED * record.torque_limits, axis=0)
        joint = int(np.argmax(share))
        unit = record.torque_unit(joint)
        evidence = (
            f"the tip carries about {estimate.mass:.2g} kg more than the law knows (± {2.0 * estimate.spread:.1g} "
            "kg); by its "
            f"torque limits alone the arm could follow the motion with {max(estimate.most, 0.0):.2g} kg, and "
            f"{record.named(joint)} is at its limit of {record.torque_limits[joint]:.4g} {unit} in "
            f"{share[joint]:.0%} of the "
            "samples from there on"
        )
        return Finding(
            name=self.name,
            joint=joint,
            weight=self._weight(record, estimate),
            evidence=evidence,
            numbers={
                "mass": estimate.mass,
                "spread": estimate.spread,
                "most": estimate.most,
                "share": float(share[joint]),
            },
            remedies=_payload_remedies(record, estimate),
        )

    def _weight(self, record: Record, estimate: Weighed) -> float:
        """Beyond the limits it is the reason, unless those were lowered; else something that u can cover."""
        if estimate.most >= estimate.mass:
            return 0.62
        return 0.93 if np.all(record.torque_limits >= data_sheet(record, "torque")) else 0.7


def weighed(record: Record, nominal: Articulated) -> Weighed:
    """Least-squares payload mass for the torque missing from the model, next to friction and a scale of the arm's mass.

    Over the samples until it left, or over those from then on, if a mass explains more of them: it may have been taken
    up then.

    - `nominal`: the arm as the law knows it.
    """
    short, long = (round(seconds / record.period) for seconds in AROUND)
    until = slice(0, min(len(record.t), max(record.left + short, long // 2)))
    after = slice(max(record.left - short // 4, 0), min(len(record.t), record.left + long))
    fits = [_weighed(record, nominal, part) for part in (until, after) if part.stop - part.start > short]
    return max(fits, key=lambda fit: fit.explained)


def _weighed(record: Record, nominal: Articulated, part: slice) -> Weighed:
    h = record.period
    q = low_passed(record.q, SLOW, h)[part]
    dq = np.gradient(q, h, axis=0)
    ddq = np.gradient(dq, h, axis=0)
    torques = [_torque(_carrying(nominal, arm), q, dq, ddq) - _torque(nominal, q, dq, ddq) for arm in ARMS]
    own = _torque(nominal, q, dq, ddq)
    n, scale = record.joints, np.where(np.isfinite(record.torque_limits), record.torque_limits, 1.0)
    friction = [np.where(np.arange(n) == joint, shape, 0.0) for shape in (np.tanh(dq / 0.02), dq) for joint in range(n)]
    lacks = (record.unexplained[part] / scale).ravel()
    columns = np.stack([(column / scale).ravel() for column in (*torques, own, *friction)], axis=1)
    solved = np.linalg.lstsq(columns, lacks, rcond=1e-8)[0]
    without = np.linalg.lstsq(columns[:, 2:], lacks, rcond=1e-8)[0]
    rest = float(np.sum((lacks - columns @ solved) ** 2))
    more = float(np.sum((lacks - columns[:, 2:] @ without) ** 2))
    mass = float(solved[0] + solved[1])
    # The residual is slow: samples count as independent only at the spacing of the filter's memory.
    fresh = max(len(q) * h * SLOW / np.pi * n, len(solved) + 1.0)
    covariance = np.linalg.pinv(columns.T @ columns) * rest / fresh
    spread = float(np.sqrt(max(np.sum(covariance[:2, :2]), 0.0)))
    # Where it is, as far as that is seen; the drives follow the motion with it, or with less.
    place = float(np.clip(solved[1] / mass if mass > LEAST else 0.5, 0.0, 1.0))
    wanted = along(nominal, record.q_d, record.dq_d)
    needed = (1.0 + solved[2]) * (np.einsum("kij,kj->ki", wanted[0], record.ddq_d) + wanted[1])
    each = [_torque(_carrying(nominal, arm), record.q_d, record.dq_d, record.ddq_d) for arm in ARMS]
    per_kg = (1.0 - place) * each[0] + place * each[1] - _torque(nominal, record.q_d, record.dq_d, record.ddq_d)
    spare = record.torque_limits - np.abs(solved[3 : 3 + n])
    with np.errstate(divide="ignore", invalid="ignore"):
        bounds = (spare - np.sign(per_kg) * needed) / np.abs(per_kg)
    most = float(np.nanmin(np.where(np.abs(per_kg) > 1e-9, bounds, np.inf)))
    return Weighed(mass, spread, 1.0 - rest / more if more > 0 else 0.0, most)


def _carrying(nominal: Articulated, arm: float) -> Articulated:
    """The arm with a kilogram more on the tip's axis."""
    more = Carried(mass=as_array(1.0), center=as_array([0.0, 0.0, arm]))
    return eqx.tree_at(lambda robot: robot.payload, nominal, nominal.payload.joined(more))


def _torque(robot: Articulated, q: np.ndarray, dq: np.ndarray, ddq: np.ndarray) -> np.ndarray:
    mass, bias = along(robot, q, dq)
    return np.einsum("kij,kj->ki", mass, ddq) + bias


def _payload_remedies(record: Record, estimate: Weighed) -> list[Remedy]:
    plant: Any = getattr(record.scenario.description.robot, "plant", None)
    path = "robot.plant.load.mass"
    loaded = getattr(plant, "load", None) is not None
    remedies = []
    for part in (0.8, 0.65, 0.5, 0.35):
        least = float(f"{part * min(estimate.mass, max(estimate.most, 0.0) / 0.8):.2g}")
        remedies.append(Remedy(f"carry at most {least:g} kg", {path: least} if loaded else {}))
    return remedies
