"""The channels of a log: what a law read, said and meant, and what a simulated arm truly did."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from .message import Field, Message, joint_state

REFERENCE = ("q_d", "dq_d", "ddq_d", "q_d_next", "dq_d_next", "ddq_d_next")
"""Now, and one period later."""

_READABLE = {
    "q_d": "position",
    "dq_d": "velocity",
    "ddq_d": "acceleration",
    "q_d_next": "next_position",
    "dq_d_next": "next_velocity",
    "ddq_d_next": "next_acceleration",
}
OF_ENVELOPE = ("s", "eps", "eps1", "rho", "u", "margin", "assumption_violated")
"""Signals that belong beside the error and its bounds."""

TIMES = ("wake", "took", "response", "logged")
"""Of a real-time loop, s: how late the law woke, how long a step took, from measurement to command, to log a row."""

MOST = 10_000
"""Joints, signals or numbers of a signal that a log may have."""


@dataclass(frozen=True)
class Channels:
    """What a log has.

    - `joints`: their names.
    - `units`: of their positions.
    - `signals`: of the law, each with how many numbers it has, None for a single one.
    - `bounded`: whether the law has an envelope.
    - `bits`: names of the bits of the status, the lowest first.
    """

    joints: tuple[str, ...]
    units: tuple[str, ...]
    signals: Mapping[str, int | None]
    bounded: bool
    bits: tuple[str, ...]

    def law(self) -> list[Message]:
        """Those of the law, a message of each for each answer."""
        n = len(self.joints)
        reference = tuple(Field(_READABLE[name], "float64", n, column=name) for name in REFERENCE)
        torque = (Field("commanded", "float64", n, column="tau"), Field("delivered", "float64", n, column="effort"))
        bounds = ("lower", "upper", "margin") if self.bounded else ()
        near = [name for name in OF_ENVELOPE if name in self.signals]
        return [
            joint_state("/joint_states", self.joints, ("q", "dq", "effort")),
            Message("/reference", "slidax_msgs/msg/Reference", reference, self.joints),
            Message("/torque", "slidax_msgs/msg/Torque", torque, self.joints),
            Message(
                "/envelope",
                "slidax_msgs/msg/Envelope",
                (
                    *(Field(name, "float64", n, column=_apart(name)) for name in ("e", *bounds)),
                    *(self._signal(name) for name in near if name != "margin"),
                ),
            ),
            Message(
                "/signals",
                "slidax_msgs/msg/Signals",
                tuple(self._signal(name) for name in self.signals if name not in near or name == "margin")
                or (Field("none", "bool"),),
            ),
            Message(
                "/status",
                "slidax_msgs/msg/Status",
                (
                    Field("time", "float64", column="t"),
                    Field("tick", "int64", column="k"),
                    Field("basis", "int64"),
                    Field("status", "uint32"),
                    *(Field(name.lower(), "bool") for name in self.bits),
                    *(Field(f"{name}_s", "float64", column=name) for name in TIMES),
                ),
            ),
        ]

    def arm(self) -> list[Message]:
        """Those of a simulated arm, a message of each for each tick."""
        n = len(self.joints)
        return [
            joint_state("/truth", self.joints, ("true_q", "true_dq", "set_tau")),
            Message(
                "/truth_status",
                "slidax_msgs/msg/TruthStatus",
                (
                    Field("time", "float64", column="true_t"),
                    Field("tick", "int64", column="true_k"),
                    Field("error", "float64", n, column="true_e"),
                    Field("applied", "int64"),
                    Field("ticks_without_command", "int64", column="missing"),
                    Field("wake_s", "float64", column="true_wake"),
                    Field("braking", "bool"),
                ),
            ),
        ]

    def as_text(self) -> str:
        """As a log keeps it."""
        return json.dumps(
            {
                "joints": self.joints,
                "units": self.units,
                "signals": dict(self.signals),
                "bounded": self.bounded,
                "bits": self.bits,
            }
        )

    @classmethod
    def of_text(cls, text: str) -> Channels:
        """Return what `as_text` has written.

        - `text`: of a log.

        Raises ValueError if it is something else.
        """
        try:
            data = json.loads(text)
            lists = [data[name] for name in ("joints", "units", "bits")]
            signals, bounded = data["signals"], data["bounded"]
        except (ValueError, KeyError, TypeError, RecursionError):
            raise ValueError("its list of channels is no such list") from None
        texts = all(isinstance(entry, list) and all(isinstance(name, str) for name in entry) for entry in lists)
        if not texts or not isinstance(signals, dict) or not isinstance(bounded, bool) or not lists[0]:
            raise ValueError("its list of channels is no such list")
        sizes = [*map(len, lists), len(signals), *(size for size in signals.values() if size is not None)]
        if not all(isinstance(size, int) and 0 <= size <= MOST for size in sizes):
            raise ValueError(f"its list of channels has more than {MOST} entries")
        joints, units, bits = map(tuple, lists)
        return cls(joints, units, signals, bounded, bits)

    def _signal(self, name: str) -> Field:
        return Field(name, "float64", self.signals[name], column=f"signal:{name}")


def _apart(name: str) -> str:
    """The margin of the envelope; a law's monitor may have a signal of that name."""
    return "envelope_margin" if name == "margin" else name


def flags(bits: Sequence[str], status: int) -> list[str]:
    """The names of the bits that are set.

    - `bits`: all names, the lowest first.
    - `status`: the bits.
    """
    return [name for place, name in enumerate(bits) if status >> place & 1]
