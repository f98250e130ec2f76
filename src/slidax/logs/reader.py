"""A log read back, also one that has no end."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from slidax._errors import DefinitionError

from .channels import Channels
from .needed import require_reader
from .writer import METADATA, SCENARIO


@dataclass(frozen=True)
class SavedLog:
    """What an MCAP file of ours has.

    - `path`: of the file.
    - `channels`: what it has.
    - `metadata`: of the run, as texts.
    - `attachments`: files by name.
    - `law`: columns with an answer of the law a row, by name; signals as `signal:NAME`.
    - `arm`: columns with a tick of a simulated arm a row; without rows for a real one.
    - `whole`: whether the file has an end; one whose writer was killed has none.
    """

    path: Path
    channels: Channels
    metadata: dict[str, str]
    attachments: dict[str, bytes]
    law: dict[str, np.ndarray]
    arm: dict[str, np.ndarray]
    whole: bool

    @property
    def scenario(self) -> str:
        """The scenario as YAML.

        Raises DefinitionError if there is none in the file.
        """
        if SCENARIO not in self.attachments:
            raise DefinitionError(f"`{self.path}` has no `{SCENARIO}` in it, which says what was run")
        return self.attachments[SCENARIO].decode()

    @property
    def files(self) -> dict[str, bytes]:
        """The files that the scenario names."""
        return {name: content for name, content in self.attachments.items() if name != SCENARIO}


def read_mcap(path: Path) -> SavedLog:
    """A log of ours.

    - `path`: the file.

    Raises DefinitionError if it cannot be read or is none of ours, or mcap is not installed.
    """
    found: dict[str, list[bytes]] = {}
    metadata: dict[str, str] | None = None
    attachments: dict[str, bytes] = {}
    topics: dict[int, str] = {}
    whole = False
    for record in _records(path):
        kind = type(record).__name__
        if kind == "Message":
            found.setdefault(topics[record.channel_id], []).append(record.data)
        elif kind == "Channel":
            topics[record.id] = record.topic
        elif kind == "Metadata" and record.name == METADATA:
            metadata = record.metadata
        elif kind == "Attachment":
            attachments[record.name] = record.data
        elif kind == "DataEnd":
            whole = True
    if metadata is None or "channels" not in metadata:
        raise DefinitionError(f"`{path}` is no log of slidax: `slidax run SCENARIO --out log.mcap` writes one")
    channels = Channels.of_text(metadata["channels"])
    sides = []
    for messages in (channels.law(), channels.arm()):
        # A chunk holds whole answers, but the last one may be cut where something else than a flush ended it.
        rows = min(len(found.get(message.topic, ())) for message in messages)
        columns: dict[str, np.ndarray] = {}
        for message in messages:
            columns |= message.unpacked(found.get(message.topic, [])[:rows])
        sides.append(columns)
    return SavedLog(path, channels, metadata, attachments, sides[0], sides[1], whole)


def read_joint_states(path: Path, topic: str = "/joint_states") -> list[dict[str, Any]]:
    """The messages `sensor_msgs/JointState` of an MCAP file, whoever wrote it, as mappings.

    - `path`: the file.
    - `topic`: of the channel.

    Raises DefinitionError if it cannot be read or has no such messages, or a package is missing.
    """
    require_reader()
    try:
        from mcap_ros2.decoder import DecoderFactory
    except ImportError:
        raise DefinitionError(
            "reading messages of ROS 2 needs mcap-ros2-support, which is not installed: pip install 'slidax[log]'"
        ) from None
    schemas: dict[int, Any] = {}
    channels: dict[int, Any] = {}
    decoders: dict[int, Any] = {}
    factory, messages = DecoderFactory(), []
    for record in _records(path):
        kind = type(record).__name__
        if kind == "Schema":
            schemas[record.id] = record
        elif kind == "Channel" and record.topic == topic and record.message_encoding == "cdr":
            channels[record.id] = record
        elif kind == "Message" and record.channel_id in channels:
            decode = decoders.get(record.channel_id)
            if decode is None:
                channel = channels[record.channel_id]
                decode = decoders[record.channel_id] = _decoder(factory, channel, schemas[channel.schema_id])
            said = decode(record.data)
            stamp = {"sec": said.header.stamp.sec, "nanosec": said.header.stamp.nanosec}
            parts = {name: list(getattr(said, name)) for name in ("name", "position", "velocity", "effort")}
            messages.append({"header": {"stamp": stamp}, **parts})
    if not messages:
        raise DefinitionError(f"`{path.name}` has no messages of ROS 2 on the topic `{topic}`")
    return messages


def _decoder(factory: Any, channel: Any, schema: Any) -> Any:
    found = factory.decoder_for(channel.message_encoding, schema)
    if found is None:
        raise DefinitionError(f"the messages on `{channel.topic}` are none of ROS 2")
    return found


def _records(path: Path) -> Iterator[Any]:
    """All records to the end, or to where the file breaks off."""
    require_reader()
    from mcap.exceptions import McapError
    from mcap.stream_reader import StreamReader

    try:
        with path.open("rb") as file:
            try:
                yield from StreamReader(file, record_size_limit=path.stat().st_size).records
            except (McapError, EOFError, struct.error, RuntimeError) as error:
                # The last two where it breaks off within a number or a compressed chunk.
                if file.tell() < 16:
                    raise DefinitionError(f"`{path}` is no MCAP file: {error}") from None
    except OSError as error:
        raise DefinitionError(f"cannot read the file `{path}`: {error.strerror}") from None
