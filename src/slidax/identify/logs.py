"""Logs of joint positions and torques, options for reading them, and their units, signs and joint order."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from slidax.core.errors import DefinitionError, count_noun, nearest_word, parse_number, plain_name, short_repr

FEWEST = 100
"""Samples that a log must have."""


class ColumnUnit(NamedTuple):
    """Base unit of a column whose title names a unit.

    - `joint`: index of the joint that the column belongs to.
    - `title`: the column's title.
    - `base`: `rad` for a revolute joint, `m` for a prismatic joint.
    """

    joint: int
    title: str
    base: str


KINDS = {"rad": "revolute", "m": "prismatic"}
"""Kind of joint by the base unit of its position."""


@dataclass(frozen=True, eq=False)
class JointLog:
    """Positions and torques of all joints over time.

    The times may repeat or run backward, as they do in bags; `identify` checks them.

    - `source`: name of the log, for messages.
    - `joints`: names of the joints, in the arm's order.
    - `t`: times [k], s.
    - `q`: positions [k n], rad or m.
    - `tau`: torques [k n], N m or N.
    - `dq`: velocities [k n], rad/s or m/s; None if they were not measured.
    - `notes`: sentences about what reading left out or converted.
    - `column_units`: units of positions and velocities that the log itself states.

    Raises DefinitionError if sizes differ, the log has fewer than 100 samples, or a number is not finite.
    """

    source: str
    joints: tuple[str, ...]
    t: np.ndarray
    q: np.ndarray
    tau: np.ndarray
    dq: np.ndarray | None = None
    notes: tuple[str, ...] = ()
    column_units: tuple[ColumnUnit, ...] = ()

    def __post_init__(self) -> None:
        k, n = len(self.t), len(self.joints)
        if k < FEWEST:
            raise DefinitionError(f"{self.source} has {k} samples: at least {FEWEST} are needed to identify anything")
        for name, values in (("q", self.q), ("tau", self.tau), ("dq", self.dq)):
            if values is None:
                continue
            if values.shape != (k, n):
                raise DefinitionError(
                    f"`{name}` of {self.source} must be {k} x {n} numbers; got shape {list(values.shape)}"
                )
            if not np.isfinite(values).all():
                row, joint = (int(index[0]) for index in np.nonzero(~np.isfinite(values)))
                raise DefinitionError(
                    f"`{name}` of {self.source} is not finite for joint `{self.joints[joint]}` in sample {row + 1}: "
                    "leave out such samples"
                )
        if not np.isfinite(self.t).all():
            row = int(np.argmin(np.isfinite(self.t)))
            raise DefinitionError(
                f"the time of sample {row + 1} of {self.source} is not finite: it is {self.t[row]:g}; "
                "leave out this sample"
            )

    def rows(self, rows: np.ndarray) -> JointLog:
        """Return the log with a selection of its samples.

        - `rows`: indices in the new order, or True for each sample to keep.
        """
        dq = None if self.dq is None else self.dq[rows]
        return replace(self, t=self.t[rows], q=self.q[rows], tau=self.tau[rows], dq=dq)

    @property
    def period(self) -> float:
        """The median time between two samples [s]; 0 if no time advances."""
        steps = np.diff(self.t)
        return float(np.median(steps[steps > 0])) if (steps > 0).any() else 0.0


@dataclass(frozen=True)
class LogColumns:
    """Columns of a table with the times and the joints' quantities.

    - `time`: title of the time column.
    - `of`: for `q`, `dq` and `tau`, the titles of the columns in the arm's joint order.
    - `scale`: for each used column, the factor from its unit to s, rad, rad/s or N m.
    - `notes`: notes on data that was left out or converted.
    - `bases`: `rad` or `m` for each column of `q` or `dq` whose title names a unit.
    """

    time: str
    of: dict[str, list[str]]
    scale: dict[str, float]
    notes: tuple[str, ...] = ()
    bases: Mapping[str, str] = field(default_factory=dict)

    @property
    def titles(self) -> list[str]:
        """Titles of all used columns."""
        return [self.time, *(title for titles in self.of.values() for title in titles)]

    def log(
        self, source: str, joints: Sequence[str], table: Mapping[str, np.ndarray], notes: Sequence[str] = ()
    ) -> JointLog:
        """Return the log in a table with these columns.

        - `source`: name of the log, for messages.
        - `joints`: the arm's joints, in its order.
        - `table`: columns by title.
        - `notes`: notes of the reader, which come first.
        """
        values = {
            name: np.stack([table[title] * self.scale.get(title, 1.0) for title in titles], axis=1)
            for name, titles in self.of.items()
        }
        times = table[self.time] * self.scale.get(self.time, 1.0)
        if len(times) and abs(times[0]) > 1e6:
            # For large times, such as seconds since 1970, keep the time since the first sample.
            times = (table[self.time] - table[self.time][0]) * self.scale.get(self.time, 1.0)
        units = tuple(
            ColumnUnit(joint, title, self.bases[title])
            for titles in self.of.values()
            for joint, title in enumerate(titles)
            if title in self.bases
        )
        notes = (*notes, *self.notes)
        return JointLog(source, tuple(joints), times, values["q"], values["tau"], values.get("dq"), notes, units)


QUANTITIES = ("t", "q", "dq", "tau")


@dataclass(frozen=True)
class ReadOptions:
    """Options for reading a log whose column titles are ambiguous.

    - `topic`: topic to read, if the log has several with joint states.
    - `columns`: the word in the column titles of `t`, `q`, `dq` or `tau`, such as `{"tau": "effort"}`, or a list with
      a title per joint.
    - `drop`: quantities (`dq`), columns, joints by name, or joints by their number in the log, to leave out.

    Raises DefinitionError if a quantity is unknown, or if `t`, `q` or `tau` is dropped.
    """

    topic: str | None = None
    columns: Mapping[str, str | Sequence[str]] = field(default_factory=dict)
    drop: Sequence[str] = ()

    def __post_init__(self) -> None:
        for quantity in self.columns:
            if quantity not in QUANTITIES:
                raise DefinitionError(
                    f"`columns` has the quantity `{plain_name(quantity)}`, but the quantities are `t`, `q`, `dq` and "
                    "`tau`: write for example `q=position,tau=effort`"
                )
        for needed in ("t", "q", "tau"):
            if needed in self.drop:
                raise DefinitionError(f"`drop` names `{needed}`, which identification needs; only `dq` may be left out")


def parse_columns(texts: Sequence[str]) -> dict[str, str | list[str]]:
    """Return each quantity's column, or list of columns, from texts such as `q=position,tau=effort` or `tau=a,b,c`.

    - `texts`: texts with one or more quantities each.

    Raises DefinitionError if a text has another form.
    """
    columns: dict[str, list[str]] = {}
    for text in texts:
        quantity = None
        for part in text.split(","):
            name, sign, word = part.partition("=")
            if sign:
                quantity = name.strip()
                columns.setdefault(quantity, []).append(word.strip())
            elif quantity is not None:
                columns[quantity].append(part.strip())
            if not quantity or not columns[quantity][-1]:
                raise DefinitionError(
                    f"`--columns {plain_name(text)}` needs the form QUANTITY=COLUMN, such as `q=position,tau=effort`"
                )
    return {quantity: words[0] if len(words) == 1 else words for quantity, words in columns.items()}


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
"""Base unit of each unit of position, and its size in this base unit."""

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
"""N m per unit of torque; for a prismatic joint N per unit of force, with `mNm` for mN and so on."""


@dataclass(frozen=True)
class Conventions:
    """Differences between a log's units, signs and joint order and the arm's own.

    Each field is also an option of `slidax identify`: `torque_sign` is `--torque-sign`. A list has an entry for each
    joint, in the arm's order; a single entry applies to all joints.

    - `time_unit`: `s`, `ms`, `us` or `ns`, or a number: the seconds per unit of the log's times.
    - `position_unit`: `rad`, `deg`, `mrad` or `rev` for all revolute joints, `m` or `mm` for all prismatic joints;
      velocities are in this unit per second.
    - `position_sign`: 1, or -1 if the log counts a joint's position in the opposite direction.
    - `position_offset`: added to the positions, rad or m.
    - `torque_unit`: `Nm`, `mNm`, `Ncm`, `kNm`, `kgfm`, `kgfcm`, `lbfft`, `lbfin` or `ozfin`.
    - `torque_scale`: factor of the torques, such as gear ratio times torque constant for motor currents.
    - `torque_sign`: 1, or -1 if the log counts a torque in the opposite direction.
    - `add_gravity`: True if the log's torques exclude gravity, as with a robot that compensates gravity internally.
    - `torque_delay`: delay of the log's torques after its positions, s.
    - `joint_order`: for each joint of the log as read, the arm's joint that its values belong to.
    - `position_order`, `torque_order`: the same for positions and velocities only, and for torques only.
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
                raise DefinitionError(f"`{name}` must be 1 or -1 for each joint; got {short_repr(getattr(self, name))}")
        if any(not np.isfinite(scale) or scale <= 0.0 for scale in self.torque_scale):
            raise DefinitionError(
                f"`torque_scale` must be > 0 and finite for each joint; got {short_repr(self.torque_scale)}; "
                "`torque_sign` changes a sign"
            )
        if not np.isfinite(self.position_offset).all():
            raise DefinitionError(f"`position_offset` must be finite; got {short_repr(self.position_offset)}")
        if not np.isfinite(self.torque_delay):
            raise DefinitionError(f"`torque_delay` must be finite; got {self.torque_delay}")
        if self.torque_unit not in TORQUE_UNITS:
            raise DefinitionError(
                f"unknown `torque_unit` `{self.torque_unit}`; {nearest_word(str(self.torque_unit), TORQUE_UNITS)}"
            )
        for unit in self.position_unit:
            if unit not in POSITION_UNITS:
                raise DefinitionError(f"unknown `position_unit` `{unit}`; {nearest_word(str(unit), POSITION_UNITS)}")
        for base, kind in KINDS.items():
            same = [unit for unit in dict.fromkeys(self.position_unit) if POSITION_UNITS[unit][0] == base]
            if len(same) > 1:
                raise DefinitionError(
                    f"`position_unit` has {count_noun(len(same), 'unit')} for {kind} joints, {', '.join(same)}: "
                    "choose one of them, for all these joints"
                )
        if not 0.0 < self.seconds < np.inf:
            raise DefinitionError(
                f"`time_unit` must be one of {', '.join(TIME_UNITS)}, or the seconds per unit, > 0; got "
                f"`{short_repr(self.time_unit)}`"
            )

    @property
    def seconds(self) -> float:
        """Seconds per unit of the log's times."""
        try:
            if self.time_unit in TIME_UNITS:
                return TIME_UNITS[self.time_unit]
            return parse_number(self.time_unit) if isinstance(self.time_unit, str) else float(self.time_unit)
        except ValueError:
            return np.nan

    def applied(self, log: JointLog, units: Sequence[str]) -> JointLog:
        """Convert a log to the arm's units, signs and joint order.

        - `log`: the log as read.
        - `units`: "rad" or "m" for each joint of the arm.

        Raises DefinitionError if a list does not have an entry for each joint, a name is no joint, or a unit does not
        fit the kind of joint.
        """
        joint_order, positions, torques = (
            self._order(name, log.joints) for name in ("joint_order", "position_order", "torque_order")
        )
        for name in self.ignore_torque:
            if name not in log.joints:
                raise DefinitionError(f"`ignore_torque`: there is no joint `{name}`; {nearest_word(name, log.joints)}")
        _require_fitting_columns(log, units, [joint_order[position] for position in positions])
        size = self._unit_sizes(units) * self.each("position_sign", len(units))
        torque = (
            TORQUE_UNITS[self.torque_unit]
            * self.each("torque_scale", len(units))
            * self.each("torque_sign", len(units))
        )
        t = log.t * self.seconds if self.seconds != 1.0 else log.t
        tau = log.tau[:, joint_order][:, torques] * torque
        if self.torque_delay:
            tau = _shifted(t, tau, self.torque_delay)
        return replace(
            log,
            t=t,
            q=log.q[:, joint_order][:, positions] * size + self.each("position_offset", len(units)),
            tau=tau,
            dq=None if log.dq is None else log.dq[:, joint_order][:, positions] * size,
            # Their joints are those of the log as read.
            column_units=(),
        )

    def _unit_sizes(self, units: Sequence[str]) -> np.ndarray:
        """Return the size of the log's unit of position for each joint, in rad or m [n]."""
        sizes = np.ones(len(units))
        for unit in self.position_unit:
            base, factor = POSITION_UNITS[unit]
            if base not in units:
                raise DefinitionError(
                    f"`position_unit` `{unit}` is for {KINDS[base]} joints, and the arm has none: leave it out"
                )
            sizes[[other == base for other in units]] = factor
        return sizes

    def each(self, name: str, joints: int) -> np.ndarray:
        """Return a field's entry for each joint [n].

        - `joints`: number of joints.

        Raises DefinitionError if the field has neither 1 nor n entries.
        """
        values = np.asarray(getattr(self, name), float)
        if values.size not in (1, joints):
            raise DefinitionError(
                f"`{name}` must have one entry, or one for each of the {joints} joints; got {values.size}"
            )
        return np.broadcast_to(values.ravel(), (joints,))

    def _order(self, name: str, joints: Sequence[str]) -> list[int]:
        """Return for each joint of the arm the index of its column in the log as read."""
        order = list(getattr(self, name))
        if not order:
            return list(range(len(joints)))
        for joint in order:
            if joint not in joints:
                raise DefinitionError(f"`{name}`: there is no joint `{joint}`; {nearest_word(joint, joints)}")
        if sorted(order) != sorted(joints):
            raise DefinitionError(f"`{name}` must name each of the {len(joints)} joints once; got {', '.join(order)}")
        return [order.index(joint) for joint in joints]


def _require_fitting_columns(log: JointLog, units: Sequence[str], columns: Sequence[int]) -> None:
    """Raise a DefinitionError if a column is in a unit of angle for a prismatic joint, or of length for a revolute one.

    - `units`: "rad" or "m" for each joint of the arm.
    - `columns`: for each joint of the arm, the joint of the log as read.
    """
    for name, unit, column in zip(log.joints, units, columns, strict=True):
        for named in log.column_units:
            if named.joint == column and named.base != unit:
                right = "angle (rad, deg)" if unit == "rad" else "length (m, mm)"
                raise DefinitionError(
                    f"{log.source}: the unit of column `{plain_name(named.title)}` does not fit joint `{name}`, which "
                    f"is {KINDS[unit]}: its unit must be one of {right}; correct the unit in the title"
                )


def _shifted(t: np.ndarray, values: np.ndarray, delay: float) -> np.ndarray:
    """Advance values by a delay; the ends keep the first or the last value."""
    in_order = np.argsort(t, kind="stable")
    return np.stack([np.interp(t + delay, t[in_order], column[in_order]) for column in values.T], axis=1)
