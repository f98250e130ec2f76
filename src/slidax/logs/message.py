"""Messages as ROS 2 has them (CDR), many at once: all numbers of a message are at fixed places."""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

DTYPES = {"float64": "<f8", "int64": "<i8", "uint32": "<u4", "bool": "u1"}
"""Kinds of numbers in a message."""

_HEADER = "=" * 80
_STAMP = f"{_HEADER}\nMSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n"
_FRAME = f"{_HEADER}\nMSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n"


@dataclass(frozen=True)
class Field:
    """A number of a message, or an array of them.

    - `name`: its own; of a column in a log, too.
    - `kind`: one of `DTYPES`.
    - `count`: how many; None for a single one.
    - `sequence`: whether the length stands before an array, as in messages of ROS whose length is not fixed.
    - `column`: what it is called in a log; as in the message if "".
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
    """A kind of message on a channel of its own.

    - `topic`: of the channel.
    - `type`: of the message, as in `sensor_msgs/msg/JointState`.
    - `fields`: after the header and the names.
    - `names`: of joints, in a field `name`; none if empty.
    """

    topic: str
    type: str
    fields: tuple[Field, ...]
    names: tuple[str, ...] = ()

    @property
    def definition(self) -> str:
        """The type in ROS 2's language, with all that it is made of."""
        lines = ["std_msgs/Header header"] + (["string[] name"] if self.names else [])
        for field in self.fields:
            size = "" if field.count is None else "[]" if field.sequence else f"[{field.count}]"
            lines.append(f"{field.kind}{size} {field.name}")
        return "\n".join(lines) + f"\n{_FRAME}{_STAMP}"

    @cached_property
    def _layout(self) -> tuple[bytes, dict[str, tuple[int, int]]]:
        """A message whose numbers are all 0, and where each field is in it: its offset and its length in bytes."""
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
        # The first bytes say that what follows is little-endian CDR.
        return b"\0\1\0\0" + bytes(body), places

    def packed(self, stamps: np.ndarray, columns: Mapping[str, np.ndarray]) -> list[bytes]:
        """Messages.

        - `stamps`: their times [ns], [m].
        - `columns`: the numbers of each field by its column, with the message as first axis.
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
        """The numbers of messages that `packed` has made, by column.

        - `messages`: in their order.

        Raises ValueError if one has another size.
        """
        blank, places = self._layout
        for number, message in enumerate(messages, 1):
            if len(message) != len(blank):
                raise ValueError(
                    f"message {number} on `{self.topic}` has {len(message)} bytes, where {len(blank)} are needed"
                )
        rows = np.frombuffer(b"".join(messages), np.uint8).reshape(len(messages), len(blank))
        found = {}
        for field in self.fields:
            offset, length = places[field.name]
            numbers = np.ascontiguousarray(rows[:, offset : offset + length]).view(DTYPES[field.kind])
            found[field.key] = numbers[:, 0] if field.count is None else numbers
        return found


def _bytes(numbers: np.ndarray, dtype: str) -> np.ndarray:
    plain = np.ascontiguousarray(numbers.astype(dtype))
    return plain.reshape(len(plain), -1).view(np.uint8)


def joint_state(topic: str, names: Sequence[str], columns: Sequence[str]) -> Message:
    """`sensor_msgs/JointState`.

    - `topic`: of the channel.
    - `names`: of the joints.
    - `columns`: what position, velocity and effort are called in a log.
    """
    fields = tuple(
        Field(name, "float64", len(names), True, column)
        for name, column in zip(("position", "velocity", "effort"), columns, strict=True)
    )
    return Message(topic, "sensor_msgs/msg/JointState", fields, tuple(names))
