"""MCAP files: write a log, read it back, and read the records of any MCAP file, even if it is damaged or hostile."""

from __future__ import annotations

import io
import struct
import zlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from slidax.core.errors import DefinitionError
from slidax.core.files import MEGABYTE, open_file

from .messages import Channels, Message


def require_package(module: str, package: str, task: str) -> Any:
    """Import a module, and return it.

    - `package`, `task`: the package to install and the task that needs it, for the error.

    Raises DefinitionError with the remedy if it is not installed.
    """
    try:
        return import_module(module)
    except ImportError:
        raise DefinitionError(f"{task} needs {package}, which is not installed: pip install 'slidax[log]'") from None


def require_writer() -> Any:
    """Return the package that writes MCAP files and serves live data.

    Raises DefinitionError with the remedy if it is not installed.
    """
    return require_package("foxglove", "foxglove-sdk", "writing MCAP")


def require_reader() -> Any:
    """Return the module that reads MCAP files.

    Raises DefinitionError with the remedy if its package is not installed.
    """
    return require_package("mcap.stream_reader", "mcap", "reading MCAP")


MOST_BYTES = 8000 * MEGABYTE
"""Size of the largest file that is read [bytes]."""

MOST_OF_A_CHUNK = 256 * MEGABYTE
"""Largest unpacked chunk [bytes]; writers end a chunk after a few MB."""

UNPACKED, RATIO = 64 * MEGABYTE, 30
"""Limit of the unpacked size of all chunks [bytes]: `UNPACKED` plus `RATIO` times the file's size. A robot's data
compress by a factor of at most 10, zeros by 1000.
"""

_SCHEMA, _CHANNEL, _MESSAGE, _PRIVATE = 3, 4, 5, 0x80


@dataclass
class Contents:
    """Records of an MCAP file, up to its end or to the first damaged record.

    - `bodies`: undecoded messages by topic.
    - `topics`: all topics, also those without messages.
    - `others`: metadata and attachments, as objects of `mcap`.
    - `complete`: True if the file has an end record.
    """

    bodies: dict[str, list[bytes]] = field(default_factory=dict)
    topics: set[str] = field(default_factory=set)
    others: list[Any] = field(default_factory=list)
    complete: bool = False


@dataclass(frozen=True, slots=True)
class _Message:
    channel_id: int
    data: bytes


class _DamagedError(Exception):
    """A record is malformed."""


def read_contents(path: Path, types: Sequence[str] = ()) -> Contents:
    """Return the records of an MCAP file.

    - `types`: keep only CDR-encoded messages of these types; by default, keep all messages and other records.

    Raises DefinitionError if the file cannot be read, is no MCAP file, or unpacks to more than a limit (`UNPACKED`,
    `RATIO`), or if mcap is not installed.
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
            contents.complete = True
        elif not types:
            contents.others.append(record)
    return contents


def _records(path: Path) -> Iterator[Any]:
    """Yield all records up to the end or the first damaged one."""
    reader = require_reader()
    with open_file(path, most=MOST_BYTES) as file:
        size = file.seek(0, io.SEEK_END)
        file.seek(0)
        left = UNPACKED + RATIO * size
        try:
            records: Iterator[Any] = reader.StreamReader(file, emit_chunks=True, record_size_limit=size).records
            for record in records:
                kind = type(record).__name__
                if kind == "Chunk":
                    left -= record.uncompressed_size
                    large = record.uncompressed_size > MOST_OF_A_CHUNK
                    if large or left < 0:
                        limit, part = UNPACKED + RATIO * size, "log of its size"
                        if large:
                            limit, part = MOST_OF_A_CHUNK, "chunk"
                        raise DefinitionError(
                            f"`{path}`, {size / MEGABYTE:.3g} MB, unpacks to more than {limit / MEGABYTE:.3g} MB, the "
                            f"limit for a {part}: write the log again without compression, in chunks of a few MB"
                        )
                    yield from _records_in_chunk(record)
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


def _records_in_chunk(chunk: Any) -> Iterator[Any]:
    from mcap.data_stream import ReadDataStream
    from mcap.records import Channel, Schema

    content = _unpacked(chunk)
    if chunk.uncompressed_crc not in (0, zlib.crc32(content)):
        raise _DamagedError("a checksum is wrong")
    start, end = 0, len(content)
    while start < end:
        kind, length = struct.unpack_from("<BQ", content, start)
        start += 9
        if length > end - start:
            raise _DamagedError("a record is longer than its chunk")
        if kind == _MESSAGE:
            if length < 22:
                raise _DamagedError("a message is too short")
            yield _Message(struct.unpack_from("<H", content, start)[0], content[start + 22 : start + length])
        elif kind in (_SCHEMA, _CHANNEL):
            reader = Schema if kind == _SCHEMA else Channel
            yield reader.read(ReadDataStream(io.BytesIO(content[start : start + length])))
        elif kind < _PRIVATE:
            raise _DamagedError("a chunk contains a record that must be outside")
        start += length


def _unpacked(chunk: Any) -> bytes:
    """Decompress a chunk, up to the size in its header."""
    most = chunk.uncompressed_size
    if chunk.compression == "":
        content: bytes = chunk.data
    elif chunk.compression == "lz4":
        import lz4.frame

        content = lz4.frame.LZ4FrameDecompressor().decompress(chunk.data, max_length=most + 1)
    elif chunk.compression == "zstd":
        import zstandard

        # A frame that needs a larger window, thus more memory, raises an error.
        unpacker = zstandard.ZstdDecompressor(max_window_size=1 << 27)
        with unpacker.stream_reader(chunk.data, read_across_frames=True) as stream:
            content = stream.read(most + 1)
    else:
        raise DefinitionError(
            f"a chunk is compressed by `{chunk.compression}`; only lz4, zstd and uncompressed chunks can be read: "
            "write the log again with one of them"
        )
    if len(content) != most:
        raise _DamagedError("a chunk's size differs from the size in its header")
    return content


SECOND = 1_000_000_000

SCENARIO = "scenario.yaml"
"""Attachment with the scenario that was run."""

METADATA = "slidax"
"""Name of the metadata record."""

Columns = Mapping[str, np.ndarray]


class _Sink:
    """A file that remembers its first error instead of raising it.

    foxglove-sdk, which writes to it, panics where the file fails, as on a full disk.
    """

    def __init__(self, path: Path) -> None:
        path.parent.mkdir(parents=True, exist_ok=True)
        self._path = path
        self._file = path.open("wb", buffering=0)
        self._error: OSError | None = None

    def write(self, data: bytes) -> int:
        """Write all of the data, or nothing after an error."""
        left = memoryview(data)
        while left and self._error is None:
            try:
                left = left[self._file.write(left) or 0 :]
            except OSError as error:
                self._error = error
        return len(data)

    def seek(self, offset: int, whence: int = 0) -> int:
        return self._file.seek(offset, whence)

    def flush(self) -> None:
        """Do nothing: the file is unbuffered."""

    def close(self) -> None:
        try:
            self._file.close()
        except OSError as error:
            self._error = self._error or error

    def require_written(self) -> None:
        """Raise an OSError with the file's name if a write failed."""
        if self._error is not None:
            raise OSError(self._error.errno, self._error.strerror, str(self._path)) from None


class LogWriter:
    """Writer of a log to an MCAP file, and to a local server for live viewers such as Foxglove.

    A truncated file can be read up to its last flush.

    - `path`: the file; None for live data only.
    - `channels`: content of the log, from which its message types follow.
    - `metadata`: metadata of the run, as texts by name.
    - `attachments`: contents of attached files by name, including `scenario.yaml`.
    - `start`: wall-clock time of t = 0 [ns].
    - `port`: port of a live-data server on this machine; None for no server.

    Raises DefinitionError if foxglove-sdk is not installed or the port is in use, OSError if the file cannot be
    written.
    """

    def __init__(
        self,
        path: str | Path | None,
        channels: Channels,
        metadata: Mapping[str, str],
        attachments: Mapping[str, bytes],
        *,
        start: int = 0,
        port: int | None = None,
    ) -> None:
        foxglove = require_writer()
        from foxglove.mcap import MCAPCompression, MCAPWriteOptions

        self._start = start
        # A separate context, so that nothing else from this process is logged here. This reference keeps it alive.
        self._context = context = foxglove.Context()
        self._server: Any = None
        if port is not None:
            try:
                self._server = foxglove.start_server(name="slidax", host="127.0.0.1", port=port, context=context)
            except Exception as error:
                raise DefinitionError(
                    f"cannot start a server at 127.0.0.1:{port}: {error}; choose another port"
                ) from None
        self._file: Any = None
        self._sink: _Sink | None = None
        if path is not None:
            # Chunks end only at a flush and are written at once, so that none is incomplete.
            options = MCAPWriteOptions(
                compression=MCAPCompression.Lz4,
                profile="ros2",
                chunk_size=None,
                disable_seeking=True,
                compression_threads=0,
            )
            self._sink = _Sink(Path(path))
            self._file = foxglove.open_mcap(self._sink, context=context, writer_options=options)
            self._file.write_metadata(METADATA, {**metadata, "channels": channels.as_text()})
            for name, content in attachments.items():
                media = "application/yaml" if name.endswith(".yaml") else "application/octet-stream"
                self._file.attach(log_time=start, create_time=start, name=name, media_type=media, data=content)
        self._law = [(message, _open_channel(foxglove, message, context)) for message in channels.law()]
        self._arm = [(message, _open_channel(foxglove, message, context)) for message in channels.arm()]

    def law(self, columns: Columns) -> None:
        """Write the law's messages for some commands.

        - `columns`: arrays by column name, one row per command; `t` has the times [s].
        """
        self._write(self._law, columns, columns["t"])

    def arm(self, columns: Columns) -> None:
        """Write the messages of a simulated arm for some ticks.

        - `columns`: arrays by column name, one row per tick; `true_t` has the times [s].
        """
        self._write(self._arm, columns, columns["true_t"])

    def flush(self) -> None:
        """End the current chunk and write it, so that it is not lost if this process ends.

        Raises OSError if the file cannot be written.
        """
        if self._file is not None:
            self._file.flush()
            self._require_written()

    def close(self) -> None:
        """Complete and close the file, and stop the server.

        Raises OSError if the file cannot be written.
        """
        if self._server is not None:
            self._server.stop()
        if self._file is not None:
            self._file.close()
            if self._sink is not None:
                self._sink.close()
            self._require_written()

    def _require_written(self) -> None:
        if self._sink is not None:
            self._sink.require_written()

    def _write(self, channels: list[tuple[Message, Any]], columns: Columns, t: np.ndarray) -> None:
        if not len(t):
            return
        stamps = self._start + np.round(t * SECOND).astype(np.int64)
        times = stamps.tolist()
        # Bypass foxglove's Python wrapper, which takes as long as the writing.
        packed = [(channel.base.log, message.packed(stamps, columns)) for message, channel in channels]
        # In time order, as readers expect.
        for k, time in enumerate(times):
            for log, messages in packed:
                log(messages[k], time)


def _open_channel(foxglove: Any, message: Message, context: Any) -> Any:
    schema = foxglove.Schema(name=message.type, encoding="ros2msg", data=message.definition.encode())
    return foxglove.Channel(message.topic, schema=schema, message_encoding="cdr", context=context)


@dataclass(frozen=True)
class SavedLog:
    """Content of an MCAP file written by slidax.

    - `metadata`: metadata of the run, as texts by name.
    - `attachments`: contents of attached files by name.
    - `law`: arrays by column name, one row per command of the law; signals as `signal:NAME`.
    - `arm`: arrays by column name, one row per tick of a simulated arm; no rows for a real arm.
    - `complete`: False if the file has no end record, as after a crash of the writer.
    """

    path: Path
    channels: Channels
    metadata: dict[str, str]
    attachments: dict[str, bytes]
    law: dict[str, np.ndarray]
    arm: dict[str, np.ndarray]
    complete: bool

    @property
    def name(self) -> str:
        """Name of the scenario; `log` if the metadata has none."""
        return self.metadata.get("scenario", "log")

    @property
    def scenario(self) -> str:
        """The scenario as YAML.

        Raises DefinitionError if it is missing or damaged.
        """
        if SCENARIO not in self.attachments:
            raise DefinitionError(f"`{self.path}` does not contain `{SCENARIO}`: record or run it again")
        try:
            return self.attachments[SCENARIO].decode()
        except UnicodeDecodeError:
            raise DefinitionError(
                f"`{self.path}` is damaged: its `{SCENARIO}` is no UTF-8 text; record or run it again"
            ) from None

    @property
    def files(self) -> dict[str, bytes]:
        """Contents of the files that the scenario refers to, by name: all attachments except the scenario."""
        return {name: content for name, content in self.attachments.items() if name != SCENARIO}


def read_mcap(path: str | Path) -> SavedLog:
    """Read a log written by slidax.

    Raises DefinitionError if it cannot be read, is damaged, is from another writer, or mcap is not installed.
    """
    path = Path(path)
    contents = read_contents(path)
    metadata: dict[str, str] | None = None
    attachments: dict[str, bytes] = {}
    for record in contents.others:
        kind = type(record).__name__
        if kind == "Metadata" and record.name == METADATA:
            metadata = record.metadata
        elif kind == "Attachment":
            attachments[record.name] = record.data
    if metadata is None or "channels" not in metadata:
        raise DefinitionError(f"`{path}` is not a slidax log: `slidax run SCENARIO --out log.mcap` writes one")
    try:
        channels = Channels.of_text(metadata["channels"])
        sides = [_columns(contents.bodies, side) for side in (channels.law(), channels.arm())]
    except ValueError as error:
        raise DefinitionError(f"`{path}` is damaged: {error}; record or run it again") from None
    return SavedLog(path, channels, metadata, attachments, sides[0], sides[1], contents.complete)


def _columns(messages: dict[str, list[bytes]], kinds: list[Message]) -> dict[str, np.ndarray]:
    # A flushed chunk has all messages of each command. The last chunk may be incomplete if it was not flushed.
    rows = min(len(messages.get(kind.topic, ())) for kind in kinds)
    columns: dict[str, np.ndarray] = {}
    for kind in kinds:
        columns |= kind.unpacked(messages.get(kind.topic, [])[:rows])
    return columns
