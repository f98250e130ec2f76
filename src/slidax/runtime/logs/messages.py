"""ROS 2 messages of a log, the channels that carry them, and their encoding in CDR, ROS 2's binary format."""

from __future__ import annotations

import json
import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

DTYPES = {"float64": "<f8", "int64": "<i8", "uint32": "<u4", "bool": "u1"}
"""NumPy types of the number types in a message."""

_HEADER = "=" * 80
_STAMP = f"{_HEADER}\nMSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n"
_FRAME = f"{_HEADER}\nMSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n"


@dataclass(frozen=True)
class MessageField:
    """A field of a ROS 2 message: a number or an array of numbers.

    - `kind`: number type, one of `DTYPES`.
    - `count`: array length; None for a scalar.
    - `sequence`: True if the length precedes the array, as for ROS arrays of variable length.
    - `column`: name of its column in a log; "" if it equals `name`.
    """

    name: str
    kind: str
    count: int | None = None
    sequence: bool = False
    column: str = ""

    @property
    def key(self) -> str:
        """Name of the field's column in a log."""
        return self.column or self.name


@dataclass(frozen=True)
class Message:
    """A ROS 2 message type and its topic.

    - `type`: name of the type, such as `sensor_msgs/msg/JointState`.
    - `fields`: fields after the header and the names.
    - `names`: joint names for the field `name`; no such field if empty.
    """

    topic: str
    type: str
    fields: tuple[MessageField, ...]
    names: tuple[str, ...] = ()

    @property
    def definition(self) -> str:
        """The type in ROS 2's interface language, with all types that it contains."""
        lines = ["std_msgs/Header header"] + (["string[] name"] if self.names else [])
        for field in self.fields:
            size = "" if field.count is None else "[]" if field.sequence else f"[{field.count}]"
            lines.append(f"{field.kind}{size} {field.name}")
        return "\n".join(lines) + f"\n{_FRAME}{_STAMP}"

    @cached_property
    def _layout(self) -> tuple[bytes, dict[str, tuple[int, int]]]:
        """A message of zeros, and the offset and length [bytes] of each field in it."""
        body = bytearray()

        def aligned(size: int) -> None:
            body.extend(bytes(-len(body) % size))

        def text(value: str) -> None:
            aligned(4)
            letters = value.encode() + b"\0"
            body.extend(struct.pack("<I", len(letters)) + letters)

        body.extend(bytes(8))
        text("")
        if self.names:
            aligned(4)
            body.extend(struct.pack("<I", len(self.names)))
            for name in self.names:
                text(name)
        positions = {}
        for field in self.fields:
            size = np.dtype(DTYPES[field.kind]).itemsize
            count = 1 if field.count is None else field.count
            if field.sequence:
                aligned(4)
                body.extend(struct.pack("<I", count))
            aligned(size)
            positions[field.name] = (4 + len(body), size * count)
            body.extend(bytes(size * count))
        # Encapsulation header: little-endian CDR.
        return b"\0\1\0\0" + bytes(body), positions

    def packed(self, stamps: np.ndarray, columns: Mapping[str, np.ndarray]) -> list[bytes]:
        """Return m messages, encoded as CDR.

        - `stamps`: times of the messages [ns], shape (m,).
        - `columns`: values of each field, by the name of its column; the first axis is the message.
        """
        blank, positions = self._layout
        rows = np.tile(np.frombuffer(blank, np.uint8), (len(stamps), 1))
        rows[:, 4:8] = _bytes(stamps // 1_000_000_000, "<i4")
        rows[:, 8:12] = _bytes(stamps % 1_000_000_000, "<u4")
        for field in self.fields:
            offset, length = positions[field.name]
            rows[:, offset : offset + length] = _bytes(columns[field.key], DTYPES[field.kind])
        encoded, size = rows.tobytes(), len(blank)
        return [encoded[k : k + size] for k in range(0, len(encoded), size)]

    def unpacked(self, messages: Sequence[bytes]) -> dict[str, np.ndarray]:
        """Decode messages from `packed`; return the values of each field, by the name of its column.

        The first axis of an array is the message.

        Raises ValueError if a message has another size.
        """
        blank, positions = self._layout
        for number, message in enumerate(messages, 1):
            if len(message) != len(blank):
                raise ValueError(f"message {number} on `{self.topic}` has {len(message)} bytes instead of {len(blank)}")
        rows = np.frombuffer(b"".join(messages), np.uint8).reshape(len(messages), len(blank))
        values = {}
        for field in self.fields:
            offset, length = positions[field.name]
            numbers = np.ascontiguousarray(rows[:, offset : offset + length]).view(DTYPES[field.kind])
            values[field.key] = numbers[:, 0] if field.count is None else numbers
        return values


def _bytes(numbers: np.ndarray, dtype: str) -> np.ndarray:
    plain = np.ascontiguousarray(numbers.astype(dtype))
    return plain.reshape(len(plain), -1).view(np.uint8)


def joint_state(topic: str, names: Sequence[str], columns: Sequence[str]) -> Message:
    """Return the type `sensor_msgs/JointState` for a topic.

    - `names`: joint names.
    - `columns`: names of the log's columns with the positions, velocities and efforts, in this order.
    """
    fields = tuple(
        MessageField(name, "float64", len(names), True, column)
        for name, column in zip(("position", "velocity", "effort"), columns, strict=True)
    )
    return Message(topic, "sensor_msgs/msg/JointState", fields, tuple(names))


REFERENCE = ("q_d", "dq_d", "ddq_d", "q_d_next", "dq_d_next", "ddq_d_next")
"""Columns of the reference position, velocity and acceleration, at a tick and one period later."""

_READABLE = {
    "q_d": "position",
    "dq_d": "velocity",
    "ddq_d": "acceleration",
    "q_d_next": "next_position",
    "dq_d_next": "next_velocity",
    "ddq_d_next": "next_acceleration",
}
ENVELOPE_SIGNALS = ("s", "eps", "eps1", "rho", "u", "margin", "assumption_violated")
"""Names of the law's signals on the topic `/envelope`; a signal `margin` is on `/signals`, to avoid equal names."""

TIMES = ("wake", "took", "response", "logged")
"""Times of a real-time loop [s]: delay of the law's wake-up, duration of a step, time from measurement to command, and
time for logging a row.
"""

MOST = 10_000
"""Largest number of joints, signals, or values of a signal in a log."""


@dataclass(frozen=True)
class Channels:
    """Content of a log of a control law and an arm, from which its message types follow.

    - `joints`, `units`: joint names and units of their positions.
    - `signals`: names of the law's signals, and their sizes; None for a scalar.
    - `bounded`: True if the law has an envelope.
    - `bits`: names of the status bits, lowest bit first.
    """

    joints: tuple[str, ...]
    units: tuple[str, ...]
    signals: Mapping[str, int | None]
    bounded: bool
    bits: tuple[str, ...]

    def law(self) -> list[Message]:
        """Message types that are written for each command of the law."""
        n = len(self.joints)
        reference = tuple(MessageField(_READABLE[name], "float64", n, column=name) for name in REFERENCE)
        torque = (
            MessageField("commanded", "float64", n, column="tau"),
            MessageField("delivered", "float64", n, column="effort"),
        )
        bounds = ("lower", "upper", "margin") if self.bounded else ()
        with_error = [name for name in ENVELOPE_SIGNALS if name in self.signals]
        return [
            joint_state("/joint_states", self.joints, ("q", "dq", "effort")),
            Message("/reference", "slidax_msgs/msg/Reference", reference, self.joints),
            Message("/torque", "slidax_msgs/msg/Torque", torque, self.joints),
            Message(
                "/envelope",
                "slidax_msgs/msg/Envelope",
                (
                    # A law's monitor may have a signal `margin`.
                    *(
                        MessageField(name, "float64", n, column="envelope_margin" if name == "margin" else name)
                        for name in ("e", *bounds)
                    ),
                    *(self._signal(name) for name in with_error if name != "margin"),
                ),
            ),
            Message(
                "/signals",
                "slidax_msgs/msg/Signals",
                tuple(self._signal(name) for name in self.signals if name not in with_error or name == "margin")
                or (MessageField("none", "bool"),),
            ),
            Message(
                "/status",
                "slidax_msgs/msg/Status",
                (
                    MessageField("time", "float64", column="t"),
                    MessageField("tick", "int64", column="k"),
                    MessageField("basis", "int64"),
                    MessageField("status", "uint32"),
                    *(MessageField(name.lower(), "bool") for name in self.bits),
                    *(MessageField(f"{name}_s", "float64", column=name) for name in TIMES),
                ),
            ),
        ]

    def arm(self) -> list[Message]:
        """Message types that are written for each tick of a simulated arm."""
        n = len(self.joints)
        return [
            joint_state("/truth", self.joints, ("true_q", "true_dq", "set_tau")),
            Message(
                "/truth_status",
                "slidax_msgs/msg/TruthStatus",
                (
                    MessageField("time", "float64", column="true_t"),
                    MessageField("tick", "int64", column="true_k"),
                    MessageField("error", "float64", n, column="true_e"),
                    MessageField("applied", "int64"),
                    MessageField("ticks_without_command", "int64", column="missing"),
                    MessageField("wake_s", "float64", column="true_wake"),
                    MessageField("braking", "bool"),
                ),
            ),
        ]

    def as_text(self) -> str:
        """Return this object as JSON, as it is stored in a log's metadata."""
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
        """Return the object that the output of `as_text` describes.

        Raises ValueError for anything else.
        """
        try:
            data = json.loads(text)
            lists = [data[name] for name in ("joints", "units", "bits")]
            signals, bounded = data["signals"], data["bounded"]
        except (ValueError, KeyError, TypeError, RecursionError):
            raise ValueError("the list of joints and signals in its metadata is malformed") from None
        texts = all(isinstance(entry, list) and all(isinstance(name, str) for name in entry) for entry in lists)
        if not texts or not isinstance(signals, dict) or not isinstance(bounded, bool) or not lists[0]:
            raise ValueError("the list of joints and signals in its metadata is malformed")
        sizes = [*map(len, lists), len(signals), *(size for size in signals.values() if size is not None)]
        if not all(isinstance(size, int) and 0 <= size <= MOST for size in sizes):
            raise ValueError(f"a size in the list of signals in its metadata is not an integer from 0 to {MOST}")
        joints, units, bits = map(tuple, lists)
        return cls(joints, units, signals, bounded, bits)

    def _signal(self, name: str) -> MessageField:
        return MessageField(name, "float64", self.signals[name], column=f"signal:{name}")


def names_of_bits(bits: Sequence[str], status: int) -> list[str]:
    """Return the names of the bits that are set in `status`; `bits` has the names of all bits, lowest bit first."""
    return [name for bit, name in enumerate(bits) if status >> bit & 1]
