"""Records of an MCAP file, including damaged and hostile files."""

from __future__ import annotations

import io
import struct
import zlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from slidax._errors import DefinitionError
from slidax._files import MEGABYTE, open_file

from .needed import require_reader

MOST_BYTES = 8000 * MEGABYTE
"""Largest file."""

MOST_OF_A_CHUNK = 256 * MEGABYTE
"""Bytes that a chunk may unpack to; writers end a chunk at some MB."""

UNPACKED, RATIO = 64 * MEGABYTE, 30
"""Bytes that all chunks may unpack to: the first number, plus the second times the size of the file. Numbers of a robot
compress to a tenth at best, zeros to a thousandth.
"""

_SCHEMA, _CHANNEL, _MESSAGE, _PRIVATE = 3, 4, 5, 0x80


@dataclass
class Contents:
    """Records of a file, up to its end or to the first damage.

    - `bodies`: undecoded messages by topic.
    - `topics`: all topics.
    - `others`: metadata and attachments, as objects of `mcap`.
    - `whole`: True if the file has an end.
    """

    bodies: dict[str, list[bytes]] = field(default_factory=dict)
    topics: set[str] = field(default_factory=set)
    others: list[Any] = field(default_factory=list)
    whole: bool = False


@dataclass(frozen=True, slots=True)
class _Message:
    channel_id: int
    data: bytes


class _DamagedError(Exception):
    """A record is malformed."""


def read_contents(path: Path, types: Sequence[str] = ()) -> Contents:
    """Return the records of an MCAP file.

    - `types`: keep only messages of these types, in CDR; by default all messages and other records.

    Raises DefinitionError if the file cannot be read, is no MCAP file, or unpacks to too much, or mcap is missing.
    """
    contents = Contents()
    schemas: dict[int, str] = {}
    channels: dict[int, str] = {}
    for record in _records(path):
        kind = type(record).__name__
        if isinstance(record, _Message):
            if record.channel_id in channels:
                contents.bodies.setdefault(channels[record.channel_id], []).append(record.data)
        elif kind == "Schema":
            schemas[record.id] = record.name
        elif kind == "Channel":
            contents.topics.add(record.topic)
            if not types or (schemas.get(record.schema_id) in types and record.message_encoding == "cdr"):
                channels[record.id] = record.topic
        elif kind == "DataEnd":
            contents.whole = True
        elif not types:
            contents.others.append(record)
    return contents


def _records(path: Path) -> Iterator[Any]:
    """Yield all records up to the end or the first damage."""
    require_reader()
    from mcap.stream_reader import StreamReader

    with open_file(path, most=MOST_BYTES) as file:
        size = file.seek(0, io.SEEK_END)
        file.seek(0)
        left = UNPACKED + RATIO * size
        try:
            records: Iterator[Any] = StreamReader(file, emit_chunks=True, record_size_limit=size).records
            for record in records:
                kind = type(record).__name__
                if kind == "Chunk":
                    left -= record.uncompressed_size
                    if record.uncompressed_size > MOST_OF_A_CHUNK or left < 0:
                        raise DefinitionError(
                            f"`{path}`, {size / MEGABYTE:.3g} MB, unpacks to more than "
                            f"{min(MOST_OF_A_CHUNK, UNPACKED + RATIO * size) / MEGABYTE:.3g} MB, more than any robot "
                            "log: if it is one, write it again without compression"
                        )
                    yield from _of_chunk(record)
                elif kind == "Message":
                    yield _Message(record.channel_id, record.data)
                else:
                    yield record
        except DefinitionError:
            raise
        # The packages that read records and unpack chunks raise any kind of error on damaged bytes.
        except Exception as error:
            if file.tell() < 16:
                reason = str(error).partition("\n")[0] or type(error).__name__
                raise DefinitionError(f"`{path}` is no MCAP file: {reason}") from None


def _of_chunk(chunk: Any) -> Iterator[Any]:
    from mcap.data_stream import ReadDataStream
    from mcap.records import Channel, Schema

    content = _unpacked(chunk)
    if chunk.uncompressed_crc not in (0, zlib.crc32(content)):
        raise _DamagedError("a checksum is wrong")
    at, end = 0, len(content)
    while at < end:
        kind, length = struct.unpack_from("<BQ", content, at)
        at += 9
        if length > end - at:
            raise _DamagedError("a record is longer than its chunk")
        if kind == _MESSAGE:
            if length < 22:
                raise _DamagedError("a message is too short")
            yield _Message(struct.unpack_from("<H", content, at)[0], content[at + 22 : at + length])
        elif kind in (_SCHEMA, _CHANNEL):
            reader = Schema if kind == _SCHEMA else Channel
            yield reader.read(ReadDataStream(io.BytesIO(content[at : at + length])))
        elif kind < _PRIVATE:
            raise _DamagedError("a chunk contains a record that must be outside")
        at += length


def _unpacked(chunk: Any) -> bytes:
    """Decompress a chunk, to not a byte more than it announces."""
    most = chunk.uncompressed_size
    if chunk.compression == "":
        content: bytes = chunk.data
    elif chunk.compression == "lz4":
        import lz4.frame

        content = lz4.frame.LZ4FrameDecompressor().decompress(chunk.data, max_length=most + 1)
    elif chunk.compression == "zstd":
        import zstandard

        # Larger frames would need larger windows.
        unpacker = zstandard.ZstdDecompressor(max_window_size=1 << 27)
        with unpacker.stream_reader(chunk.data, read_across_frames=True) as stream:
            content = stream.read(most + 1)
    else:
        raise DefinitionError(
            f"a chunk is compressed by `{chunk.compression}`; only lz4, zstd and uncompressed chunks can be read: "
            "write the log again with one of them"
        )
    if len(content) != most:
        raise _DamagedError("a chunk's size differs from the announced size")
    return content
