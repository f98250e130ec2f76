"""Conventions of a log: its units, signs and joint order."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from slidax._errors import DefinitionError, nearest, shown

from .log import Log

TIME_UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
"""Seconds per unit of time."""

POSITION_UNITS = {
    "rad": ("rad", 1.0),
    "mrad": ("rad", 1e-3),
    "deg": ("rad", np.pi / 180.0),
    "rev": ("rad", 2.0 * np.pi),
    "m": ("m", 1.0),
    "mm": ("m", 1e-3),
}
"""The kind of joint that a unit of position belongs to, and its size in rad or m."""

TORQUE_UNITS = {
    "Nm": 1.0,
    "mNm": 1e-3,
    "Ncm": 1e-2,
    "kNm": 1e3,
    "kgfm": 9.80665,
    "kgfcm": 0.0980665,
    "lbfft": 1.3558179,
    "lbfin": 0.1129848,
    "ozfin": 0.00706155,
}
"""N m per unit of torque; for a sliding joint N per unit of force, with `mNm` for mN and so on."""


@dataclass(frozen=True)
class Conventions:
    """Differences between a log and the arm's own units, signs and joint order.

    Each field has an option of `slidax identify`: `torque_sign` is `--torque-sign`. A list has an entry for each joint,
    in the arm's order; a single entry is for all joints.

    - `time_unit`: `s`, `ms`, `us` or `ns`, or a number: the seconds per unit of the log's times.
    - `position_unit`: `rad`, `deg`, `mrad` or `rev` for turning joints, `m` or `mm` for sliding joints; velocities are
      in this unit per second.
    - `position_sign`: 1, or -1 for a joint that the log counts in the opposite direction.
    - `position_offset`: added to the positions, rad or m.
    - `torque_unit`: `Nm`, `mNm`, `Ncm`, `kNm`, `kgfm`, `kgfcm`, `lbfft`, `lbfin` or `ozfin`.
    - `torque_scale`: a factor of the torques, such as gear ratio times torque constant for motor currents.
    - `torque_sign`: 1, or -1 for a torque that the log counts in the opposite direction.
    - `add_gravity`: whether the log's torques lack those of gravity, which the controller compensates by itself.
    - `torque_delay`: the time by which the log's torques come after its positions, s.
    - `joint_order`: for each joint of the log as read, the arm's joint that its values belong to.
    - `position_order`, `torque_order`: the same for positions and velocities alone, and for torques alone.
    - `ignore_torque`: joints whose torques are not used.

    Raises DefinitionError if a unit is unknown, or a number is out of range.
    """

    time_unit: str | float = "s"
    position_unit: Sequence[str] = ()
    position_sign: Sequence[float] = (1.0,)
    position_offset: Sequence[float] = (0.0,)
    torque_unit: str = "Nm"
    torque_scale: Sequence[float] = (1.0,)
    torque_sign: Sequence[float] = (1.0,)
    add_gravity: bool = False
    torque_delay: float = 0.0
    joint_order: Sequence[str] = ()
    position_order: Sequence[str] = ()
    torque_order: Sequence[str] = ()
    ignore_torque: Sequence[str] = ()

    def __post_init__(self) -> None:
        for name in ("position_sign", "torque_sign"):
            if any(sign not in (1.0, -1.0) for sign in getattr(self, name)):
                raise DefinitionError(f"`{name}` must be 1 or -1 for each joint; got {shown(getattr(self, name))}")
        if any(not np.isfinite(scale) or scale <= 0.0 for scale in self.torque_scale):
            raise DefinitionError(
                f"`torque_scale` must be > 0 and finite for each joint; got {shown(self.torque_scale)}; "
                "`torque_sign` turns a sign"
            )
        if not np.isfinite(self.position_offset).all():
            raise DefinitionError(f"`position_offset` must be finite; got {shown(self.position_offset)}")
        if not np.isfinite(self.torque_delay):
            raise DefinitionError(f"`torque_delay` must be finite; got {self.torque_delay}")
        if self.torque_unit not in TORQUE_UNITS:
            raise DefinitionError(
                f"unknown `torque_unit` `{self.torque_unit}`; {nearest(str(self.torque_unit), TORQUE_UNITS)}"
            )
        for unit in self.position_unit:
            if unit not in POSITION_UNITS:
                raise DefinitionError(f"unknown `position_unit` `{unit}`; {nearest(str(unit), POSITION_UNITS)}")
        if not 0.0 < self.seconds < np.inf:
            raise DefinitionError(
                f"`time_unit` must be one of {', '.join(TIME_UNITS)}, or the seconds per unit, > 0; got "
                f"`{shown(self.time_unit)}`"
            )

    @property
    def seconds(self) -> float:
        """Seconds per unit of the log's times."""
        try:
            return TIME_UNITS[self.time_unit] if self.time_unit in TIME_UNITS else float(self.time_unit)
        except ValueError:
            return np.nan

    def applied(self, log: Log, units: Sequence[str]) -> Log:
        """The log in the arm's units, signs and joint order.

        - `log`: as read.
        - `units`: "rad" or "m" for each joint of the arm.

        Raises DefinitionError if a list does not have an entry for each joint, or a name is not a joint's.
        """
        whole, positions, torques = (
            self._order(name, log.joints) for name in ("joint_order", "position_order", "torque_order")
        )
        for name in self.ignore_torque:
            if name not in log.joints:
                raise DefinitionError(f"`ignore_torque`: there is no joint `{name}`; {nearest(name, log.joints)}")
        size = np.ones(len(units))
        for unit in self.position_unit:
            kind, factor = POSITION_UNITS[unit]
            size[[other == kind for other in units]] = factor
        size = size * self.each("position_sign", len(units))
        torque = (
            TORQUE_UNITS[self.torque_unit]
            * self.each("torque_scale", len(units))
            * self.each("torque_sign", len(units))
        )
        t = log.t * self.seconds if self.seconds != 1.0 else log.t
        tau = log.tau[:, whole][:, torques] * torque
        if self.torque_delay:
            tau = _shifted(t, tau, self.torque_delay)
        return replace(
            log,
            t=t,
            q=log.q[:, whole][:, positions] * size + self.each("position_offset", len(units)),
            tau=tau,
            dq=None if log.dq is None else log.dq[:, whole][:, positions] * size,
        )

    def each(self, name: str, joints: int) -> np.ndarray:
        """A field's entries, one for each joint [n].

        - `joints`: their number.

        Raises DefinitionError if it has another number of entries.
        """
        values = np.asarray(getattr(self, name), float)
        if values.size not in (1, joints):
            raise DefinitionError(
                f"`{name}` must have one entry, or one for each of the {joints} joints; got {values.size}"
            )
        return np.broadcast_to(values.ravel(), (joints,))

    def _order(self, name: str, joints: Sequence[str]) -> list[int]:
        """For each joint of the arm, the column of the log as read that has its values."""
        order = list(getattr(self, name))
        if not order:
            return list(range(len(joints)))
        for joint in order:
            if joint not in joints:
                raise DefinitionError(f"`{name}`: there is no joint `{joint}`; {nearest(joint, joints)}")
        if sorted(order) != sorted(joints):
            raise DefinitionError(f"`{name}` must name each of the {len(joints)} joints once; got {', '.join(order)}")
        return [order.index(joint) for joint in joints]


def _shifted(t: np.ndarray, values: np.ndarray, delay: float) -> np.ndarray:
    """Values of a later time at each time; the ends keep the first or the last value."""
    in_order = np.argsort(t, kind="stable")
    return np.stack([np.interp(t + delay, t[in_order], column[in_order]) for column in values.T], axis=1)
