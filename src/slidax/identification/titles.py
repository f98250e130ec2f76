"""Titles of columns: the words and units in them, and what these mean."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import pi

from slidax._errors import DefinitionError, plain

TIMES = ("t", "time", "timestamp", "__time", "%time", "seconds", "stamp", "elapsed", "duration", "rosbagtimestamp")
"""Titles for the column of times, the likeliest first."""

WORDS = {
    "q": ("q", "position", "pos", "actual_q", "joint_position", "q_measured", "measured_position", "angle", "theta"),
    "dq": ("dq", "velocity", "vel", "qd", "actual_qd", "joint_velocity", "qdot", "speed"),
    "tau": ("tau", "torque", "effort", "tau_j", "joint_torque", "tau_measured", "measured_torque", "joint_effort"),
}
"""Words for a quantity in a title, before or after the joint, the likeliest first, also of libfranka and RTDE."""

PLURALS = {"positions": "position", "velocities": "velocity", "torques": "torque", "efforts": "effort"}
"""Words for all joints, which a title may have in place of the word for one."""

CURRENTS = ("current", "actual_current", "motor_current", "joint_current")
COMPUTED = ("target_moment", "tau_j_d", "target_torque", "desired_torque", "commanded_torque")
"""Words for columns that are not measured torques: currents, and torques that a controller has computed."""

UNITS: dict[str, dict[str, float]] = {
    "t": {"s": 1.0, "sec": 1.0, "seconds": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "μs": 1e-6, "ns": 1e-9},
    "q": {"rad": 1.0, "deg": pi / 180, "degrees": pi / 180, "°": pi / 180, "m": 1.0, "mm": 1e-3},
    "dq": {"rad/s": 1.0, "rads1": 1.0, "deg/s": pi / 180, "°/s": pi / 180, "m/s": 1.0, "mm/s": 1e-3, "rpm": pi / 30},
    "tau": {"nm": 1.0, "n": 1.0, "mnm": 1e-3, "nmm": 1e-3, "knm": 1e3, "kn": 1e3, "ncm": 1e-2},
}
"""Units that a title may name, and what one of them is in s, rad, rad/s or N m."""

STATES = ("", "state", "robot_state", "joint_states", "joint_state", "measured", "actual", "feedback", "robot0")
"""Prefixes of measured columns, as in `state.q[0]` next to `cmd.q[0]`."""

COMMANDS = ("cmd", "command", "desired", "target", "goal", "reference", "ref", "setpoint", "output", "error")
"""Words before a column that was not measured."""

RATES = ("success_rate", "state.success_rate", "control_command_success_rate")
"""Titles that libfranka writes next to its times, which are milliseconds."""

INDEX = re.compile(r"(?P<stem>.*?)[._]?(?:\[(?P<a>\d{1,6})\]|\((?P<b>\d{1,6})\)|(?P<c>\d{1,6}))")
JOINT = re.compile(r"(?:joint|axis|motor|j)[_.]?(?P<index>\d{1,6})")
_UNIT = re.compile(r"\s*(?:\[(?P<a>[^\[\]]*)\]|\((?P<b>[^()]*)\))$")
_ENDING = re.compile(r"(?<=[a-z0-9\])])_(?P<unit>ms|us|ns|s|sec|rad|deg|nm)$")
"""A unit at the end of a title, as in `time_ms` and `q_1_deg`."""


@dataclass(frozen=True)
class Title:
    """A title in its parts.

    - `bare`: without its unit, its parts separated by points.
    - `unit`: as it is in the title; empty if there is none.
    """

    text: str
    bare: str
    unit: str

    @classmethod
    def of(cls, text: str) -> Title:
        """Return the parts of a title."""
        bare, unit = text.strip().strip("\"'").strip(), ""
        matched = _UNIT.search(bare)
        if matched is not None:
            inside = matched["a"] if matched["a"] is not None else matched["b"]
            if not inside.strip().isdigit():
                bare, unit = bare[: matched.start()], inside
        bare = re.sub(r"[/:]+", ".", re.sub(r"\s+", "_", bare.strip())).strip(".")
        ending = _ENDING.search(bare.lower())
        if (
            ending is not None
            and not unit
            and (ending["unit"] not in UNITS["t"] or ending.string[: ending.start()] in TIMES)
        ):
            bare, unit = bare[: ending.start()], ending["unit"]
        return cls(text, bare, unit.strip())

    def suffixes(self) -> Iterator[tuple[str, str]]:
        """The title from each of its parts on, the whole one first, with what stands before."""
        parts = self.bare.split(".")[-6:]
        for start in range(len(parts)):
            yield ".".join(parts[:start]), ".".join(parts[start:])


def rank_of_state(prefix: str) -> int:
    """Return the rank of what stands before a word: measured states first, commands last.

    - `prefix`: separated by points.
    """
    last = prefix.rpartition(".")[2]
    return STATES.index(last) if last in STATES else len(STATES) + is_command(prefix)


def is_command(prefix: str) -> bool:
    """Return True if a column with these words before its quantity was not measured.

    - `prefix`: separated by points.
    """
    return prefix.rpartition(".")[2] in COMMANDS


def scale_of(quantity: str, title: Title, source: str) -> tuple[float, str]:
    """Return the value of a column's unit in rad, rad/s or N m, and a note about the conversion.

    - `quantity`: `q`, `dq` or `tau`.
    - `source`: of the table, for messages.

    Raises DefinitionError if the unit is not known.
    """
    unit = re.sub(r"[\s·*⋅.^-]", "", title.unit)
    if unit in ("", "1", "SI"):
        return 1.0, ""
    # Only in these, capitals matter.
    scale = 1e6 if quantity == "tau" and unit in ("MNm", "MN") else UNITS[quantity].get(unit.lower())
    if scale is None:
        options = ", ".join(list(UNITS[quantity])[:4])
        raise DefinitionError(
            f"{source}: column `{plain(title.text)}` is in `{plain(title.unit)}`, which is no known unit of "
            f"`{quantity}` ({options}, ...): convert the column, or correct the unit in its title"
        )
    return scale, "" if scale == 1.0 else f"`{quantity}` is converted from {plain(title.unit)}, the unit in the title"


def scale_of_time(title: Title, titles: Sequence[Title], source: str) -> tuple[float, str]:
    """Return the value of the unit of a column of times in s, and a note about the conversion.

    - `titles`: of all columns, which may show the tool that wrote them.
    - `source`: of the table, for messages.

    Raises DefinitionError if the unit is not known.
    """
    unit = title.unit.lower().strip()
    if not unit and title.bare.lower() in ("%time", "rosbagtimestamp"):
        return 1e-9, f"the times in `{plain(title.text)}` are nanoseconds, as ROS writes them"
    if not unit and any(other.bare.lower() in RATES for other in titles):
        return 1e-3, f"the times in `{plain(title.text)}` are milliseconds, as libfranka writes them"
    scale = UNITS["t"].get(unit) if unit else 1.0
    if scale is None:
        raise DefinitionError(
            f"{source}: column `{plain(title.text)}` is in `{plain(title.unit)}`, which is no unit of time "
            "(s, ms, us, ns): convert the column, or correct the unit in its title"
        )
    return scale, "" if scale == 1.0 else f"the times are converted from {plain(title.unit)}, the unit in the title"
