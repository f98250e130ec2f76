"""Write a log as an MCAP file, and serve the same messages live."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from .channels import Channels
from .message import Message
from .needed import require_writer

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
    """Writes messages in chunks that are complete once flushed, so that a file without an end can be read.

    - `path`: of the file; None for live data alone.
    - `metadata`: of the run, as texts.
    - `attachments`: files by name, `scenario.yaml` among them.
    - `start`: wall-clock time of t = 0 [ns].
    - `port`: of a live-data server on this machine; None for none.

    Raises DefinitionError if foxglove-sdk is not installed or the port is taken, OSError if the file cannot be written.
    """

    def __init__(
        self,
        path: Path | None,
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
        # A context of its own, so that nothing else from this process is logged here. Kept alive by this reference.
        self._context = context = foxglove.Context()
        self._server: Any = None
        if port is not None:
            try:
                self._server = foxglove.start_server(name="slidax", host="127.0.0.1", port=port, context=context)
            except Exception as error:
                from slidax._errors import DefinitionError

                raise DefinitionError(f"cannot start a server at 127.0.0.1:{port}: {error}") from None
        self._file: Any = None
        self._sink: _Sink | None = None
        if path is not None:
            # Chunks end at a flush and are written at once, so that none is left incomplete.
            options = MCAPWriteOptions(
                compression=MCAPCompression.Lz4,
                profile="ros2",
                chunk_size=None,
                disable_seeking=True,
                compression_threads=0,
            )
            self._sink = _Sink(path)
            self._file = foxglove.open_mcap(self._sink, context=context, writer_options=options)
            self._file.write_metadata(METADATA, {**metadata, "channels": channels.as_text()})
            for name, content in attachments.items():
                media = "application/yaml" if name.endswith(".yaml") else "application/octet-stream"
                self._file.attach(log_time=start, create_time=start, name=name, media_type=media, data=content)
        self._law = [(message, _opened(foxglove, message, context)) for message in channels.law()]
        self._arm = [(message, _opened(foxglove, message, context)) for message in channels.arm()]

    def law(self, columns: Columns) -> None:
        """Write answers of the law: columns by name, with the answer as first axis."""
        self._write(self._law, columns, columns["t"])

    def arm(self, columns: Columns) -> None:
        """Write ticks of a simulated arm: columns by name, with the tick as first axis."""
        self._write(self._arm, columns, columns["true_t"])

    def flush(self) -> None:
        """Complete the chunk, which survives the end of this process.

        Raises OSError if the file cannot be written.
        """
        if self._file is not None:
            self._file.flush()
            self._require_written()

    def close(self) -> None:
        """End the file and the server.

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
        # Bypasses the wrapper, which takes as long as the writing.
        packed = [(channel.base.log, message.packed(stamps, columns)) for message, channel in channels]
        # In time order, as readers expect.
        for k, time in enumerate(times):
            for log, messages in packed:
                log(messages[k], time)


def _opened(foxglove: Any, message: Message, context: Any) -> Any:
    schema = foxglove.Schema(name=message.type, encoding="ros2msg", data=message.definition.encode())
    return foxglove.Channel(message.topic, schema=schema, message_encoding="cdr", context=context)
