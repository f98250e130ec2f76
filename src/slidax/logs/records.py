"""The records of an MCAP file, damaged and hostile ones included."""

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
"""Of a file."""

MOST_OF_A_CHUNK = 256 * MEGABYTE
"""Bytes that a chunk unpacks to; writers end a chunk at some MB."""

UNPACKED, RATIO = 64 * MEGABYTE, 30
"""Bytes that all chunks may unpack to: the first, and the second times the size of the file. Numbers of a robot are
packed to a tenth at best, zeros to a thousandth."""

_SCHEMA, _CHANNEL, _MESSAGE, _PRIVATE = 3, 4, 5, 0x80


@dataclass
class Contents:
    """The records of a file, up to its end or up to where it breaks off or is damaged.

    - `bodies`: messages as they were sent, by topic.
    - `topics`: all of them.
    - `others`: metadata and attachments, by the package `mcap`.
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
    """A record is not what it must be."""


def read_contents(path: Path, types: Sequence[str] = ()) -> Contents:
    """Return the records of an MCAP file.

    - `path`: of the file.
    - `types`: of the only messages that are kept, in CDR; all messages and other records are kept if not given.

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
    """All records up to the end, or up to where the file breaks off: messages, and the others as `mcap` has them."""
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
                            f"{min(MOST_OF_A_CHUNK, UNPACKED + RATIO * size) / MEGABYTE:.3g} MB, as no log of a robot "
                            "does; write it again without compression if it is one"
                        )
                    yield from _of_chunk(record)
                elif kind == "Message":
                    yield _Message(record.channel_id, record.data)
                else:
                    yield record
        except DefinitionError:
            raise
        # The packages that read records and unpack chunks raise whatever a damaged byte leads them to.
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
            raise _DamagedError("a chunk has a record that belongs outside")
        at += length


def _unpacked(chunk: Any) -> bytes:
    """The content of a chunk, not a byte more than it announces."""
    most = chunk.uncompressed_size
    if chunk.compression == "":
        content: bytes = chunk.data
    elif chunk.compression == "lz4":
        import lz4.frame

        content = lz4.frame.LZ4FrameDecompressor().decompress(chunk.data, max_length=most + 1)
    elif chunk.compression == "zstd":
        import zstandard

        # Frames of more than this would need windows of that size.
        unpacker = zstandard.ZstdDecompressor(max_window_size=1 << 27)
        with unpacker.stream_reader(chunk.data, read_across_frames=True) as stream:
            content = stream.read(most + 1)
    else:
        raise DefinitionError(
            f"a chunk is packed by `{chunk.compression}`: only lz4, zstd and unpacked ones are read; write the log "
            "again with one of them"
        )
    if len(content) != most:
        raise _DamagedError("a chunk has another size than it announces")
    return content
