"""ROS 2 messages in CDR, encoded many at once: every number of a message has a fixed place."""

from __future__ import annotations

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
class Field:
    """A number of a message, or an array of numbers.

    - `kind`: one of `DTYPES`.
    - `count`: array length; None for a scalar.
    - `sequence`: True if the length precedes the array, as in ROS messages of variable length.
    - `column`: its name in a log; "" if it is `name`.
    """

    name: str
    kind: str
    count: int | None = None
    sequence: bool = False
    column: str = ""

    @property
    def key(self) -> str:
        """Its column."""
        return self.column or self.name


@dataclass(frozen=True)
class Message:
    """A message type on a channel of its own.

    - `type`: such as `sensor_msgs/msg/JointState`.
    - `fields`: after the header and the names.
    - `names`: joint names in a field `name`; no such field if empty.
    """

    topic: str
    type: str
    fields: tuple[Field, ...]
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
        places = {}
        for field in self.fields:
            size = np.dtype(DTYPES[field.kind]).itemsize
            count = 1 if field.count is None else field.count
            if field.sequence:
                aligned(4)
                body.extend(struct.pack("<I", count))
            aligned(size)
            places[field.name] = (4 + len(body), size * count)
            body.extend(bytes(size * count))
        # Encapsulation header: little-endian CDR.
        return b"\0\1\0\0" + bytes(body), places

    def packed(self, stamps: np.ndarray, columns: Mapping[str, np.ndarray]) -> list[bytes]:
        """Encode messages.

        - `stamps`: their times [ns], [m].
        - `columns`: values of each field by column, with the message as first axis.
        """
        blank, places = self._layout
        rows = np.tile(np.frombuffer(blank, np.uint8), (len(stamps), 1))
        rows[:, 4:8] = _bytes(stamps // 1_000_000_000, "<i4")
        rows[:, 8:12] = _bytes(stamps % 1_000_000_000, "<u4")
        for field in self.fields:
            offset, length = places[field.name]
            rows[:, offset : offset + length] = _bytes(columns[field.key], DTYPES[field.kind])
        whole, size = rows.tobytes(), len(blank)
        return [whole[k : k + size] for k in range(0, len(whole), size)]

    def unpacked(self, messages: Sequence[bytes]) -> dict[str, np.ndarray]:
        """Decode messages from `packed`, by column.

        Raises ValueError if one has another size.
        """
        blank, places = self._layout
        for number, message in enumerate(messages, 1):
            if len(message) != len(blank):
                raise ValueError(f"message {number} on `{self.topic}` has {len(message)} bytes instead of {len(blank)}")
        rows = np.frombuffer(b"".join(messages), np.uint8).reshape(len(messages), len(blank))
        values = {}
        for field in self.fields:
            offset, length = places[field.name]
            numbers = np.ascontiguousarray(rows[:, offset : offset + length]).view(DTYPES[field.kind])
            values[field.key] = numbers[:, 0] if field.count is None else numbers
        return values


def _bytes(numbers: np.ndarray, dtype: str) -> np.ndarray:
    plain = np.ascontiguousarray(numbers.astype(dtype))
    return plain.reshape(len(plain), -1).view(np.uint8)


def joint_state(topic: str, names: Sequence[str], columns: Sequence[str]) -> Message:
    """`sensor_msgs/JointState` whose position, velocity and effort have these columns in a log."""
    fields = tuple(
        Field(name, "float64", len(names), True, column)
        for name, column in zip(("position", "velocity", "effort"), columns, strict=True)
    )
    return Message(topic, "sensor_msgs/msg/JointState", fields, tuple(names))
