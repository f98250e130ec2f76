"""The records of an MCAP file, damaged and hostile ones included."""

from __future__ import annotations

import io
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
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


@dataclass(frozen=True, slots=True)
class Message:
    """A message.

    - `channel_id`: number of its channel.
    - `log_time`: when it was logged [ns].
    - `data`: as it was sent.
    """

    channel_id: int
    log_time: int
    data: bytes


class _DamagedError(Exception):
    """A record is not what it must be."""


def read_records(path: Path) -> Iterator[Any]:
    """Yield all records up to the end, or up to where the file breaks off or is damaged.

    Records of other kinds than messages are those of the package `mcap`. A whole file has a `DataEnd`.

    - `path`: of the file.

    Raises DefinitionError if the file cannot be read, is no MCAP file, or unpacks to too much, or mcap is missing.
    """
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
                    yield Message(record.channel_id, record.log_time, record.data)
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
            channel, _, log_time = struct.unpack_from("<HIQ", content, at)
            if length < 22:
                raise _DamagedError("a message is too short")
            yield Message(channel, log_time, content[at + 22 : at + length])
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
