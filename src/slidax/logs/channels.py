"""Channels of a log: the law's inputs, outputs and signals, and the true motion of a simulated arm."""

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
"""Signals shown together with the error and its bounds."""

TIMES = ("wake", "took", "response", "logged")
"""Times of a real-time loop [s]: delay of the law's wake-up, duration of a step, measurement to command, logging of a
row.
"""

MOST = 10_000
"""Largest number of joints, signals, or values of a signal in a log."""


@dataclass(frozen=True)
class Channels:
    """Content of a log.

    - `joints`, `units`: joint names and units of their positions.
    - `signals`: the law's signals with their sizes; None for a scalar.
    - `bounded`: True if the law has an envelope.
    - `bits`: names of the status bits, lowest first.
    """

    joints: tuple[str, ...]
    units: tuple[str, ...]
    signals: Mapping[str, int | None]
    bounded: bool
    bits: tuple[str, ...]

    def law(self) -> list[Message]:
        """Messages written for each answer of the law."""
        n = len(self.joints)
        reference = tuple(Field(_READABLE[name], "float64", n, column=name) for name in REFERENCE)
        torque = (Field("commanded", "float64", n, column="tau"), Field("delivered", "float64", n, column="effort"))
        bounds = ("lower", "upper", "margin") if self.bounded else ()
        with_error = [name for name in OF_ENVELOPE if name in self.signals]
        return [
            joint_state("/joint_states", self.joints, ("q", "dq", "effort")),
            Message("/reference", "slidax_msgs/msg/Reference", reference, self.joints),
            Message("/torque", "slidax_msgs/msg/Torque", torque, self.joints),
            Message(
                "/envelope",
                "slidax_msgs/msg/Envelope",
                (
                    *(Field(name, "float64", n, column=_apart(name)) for name in ("e", *bounds)),
                    *(self._signal(name) for name in with_error if name != "margin"),
                ),
            ),
            Message(
                "/signals",
                "slidax_msgs/msg/Signals",
                tuple(self._signal(name) for name in self.signals if name not in with_error or name == "margin")
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
        """Messages written for each tick of a simulated arm."""
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
        """JSON, as stored in a log."""
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
        """Parse the output of `as_text`.

        Raises ValueError for anything else.
        """
        try:
            data = json.loads(text)
            lists = [data[name] for name in ("joints", "units", "bits")]
            signals, bounded = data["signals"], data["bounded"]
        except (ValueError, KeyError, TypeError, RecursionError):
            raise ValueError("its list of channels is malformed") from None
        texts = all(isinstance(entry, list) and all(isinstance(name, str) for name in entry) for entry in lists)
        if not texts or not isinstance(signals, dict) or not isinstance(bounded, bool) or not lists[0]:
            raise ValueError("its list of channels is malformed")
        sizes = [*map(len, lists), len(signals), *(size for size in signals.values() if size is not None)]
        if not all(isinstance(size, int) and 0 <= size <= MOST for size in sizes):
            raise ValueError(f"its list of channels has more than {MOST} entries")
        joints, units, bits = map(tuple, lists)
        return cls(joints, units, signals, bounded, bits)

    def _signal(self, name: str) -> Field:
        return Field(name, "float64", self.signals[name], column=f"signal:{name}")


def _apart(name: str) -> str:
    """Column of the envelope's margin; a law's monitor may have a signal of that name."""
    return "envelope_margin" if name == "margin" else name


def flags(bits: Sequence[str], status: int) -> list[str]:
    """Names of the bits that are set in `status`; `bits` has all names, lowest first."""
    return [name for place, name in enumerate(bits) if status >> place & 1]
